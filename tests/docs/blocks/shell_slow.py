"""The commands that `make full` runs, shortened; `make test` puts what they would leave in its place."""

from typing import Final

from tests.docs.blocks.plan import Run

SPANS: Final = (
    (r"--lead-in\n[\d.]+", ""),
    (r"--controlled\n[\d.]+", ""),
    (r"--settle\n[\d.]+", ""),
    (r"--no-averages", ""),
    # Disturbances and faults of a run of 0.9 s.
    (r"@\d+\.\.\d+", "@0.75..0.85"),
    (r"@\d+\.\.$", "@0.75.."),
    (r"@\d+\.\.\n", "@0.75..\n"),
)
SHORT: Final = "--lead-in 7 --controlled 2 --no-averages --set flow.refinement=0.4"
"""A coarse mesh: the wake is not the paper's, the way through the commands is the same."""
NETWORKS: Final = " ".join(
    f"--set {one}"
    for one in (
        *("model.lstm_width=8", "model.dynamics_width=16", "model.decoder_width=8"),
        *("model.slim_dynamics_width=8", "model.slim_decoder_width=4"),
        *("train.epochs=0.05", "train.finish.epochs=0.05", "train.stream_epochs=0.05", "train.distil_epochs=0.05"),
        *("train.predictor_epochs=0.05", "train.predictor_lessons=64"),
        *("train.shap_background=5", "train.shap_explained=5", "train.shap_repeats=1", "train.shap_samples=1"),
    )
)
REMOVED: Final = tuple(
    (rf"--set\n{name}=[^\n]+", "")
    for name in (r"train\.(?:finish\.|stream_)?epochs", r"model\.slim_dynamics_width", r"model\.slim_decoder_width")
)

SLOW: Final = (
    Run(
        form=r"stillwake run \S+ .*--require-reduction 20.*",
        shortened=SPANS,
        added="--lead-in 10 --controlled 10 --settle 0 --set flow.refinement=0.4",
        slow=True,
        instead=("run", 2),
        statuses=(4,),
    ),
    Run(
        form=r"stillwake run runs/(a|b --lead-in 30 .*)",
        shortened=SPANS,
        added=SHORT,
        slow=True,
        instead=("run", 2),
        # The lines behind it make a data set of it, which has to have some length.
        replaced=True,
        statuses=(0, 3),
    ),
    # A pressure is lost, or an answer is late: status 3 is what the page speaks of.
    Run(
        form=r"stillwake run .*",
        shortened=SPANS,
        added=SHORT,
        slow=True,
        instead=("run", 2),
        statuses=(0, 3),
    ),
    Run(
        form=r"stillwake train .*",
        # A shell puts in the names that a script prints.
        shortened=(*REMOVED, (r"--quick", ""), (r"\$\(.*\)", "upper_39,lower_39,base_0,base_9")),
        added=NETWORKS,
        slow=True,
        instead=("model", 2),
        # Export refuses what was trained for seconds.
        replaced=True,
    ),
    Run(
        form=r"stillwake export \S+ \S+ --key keys/release\.key",
        slow=True,
        instead=("signed", 3),
    ),
    Run(
        form=r"stillwake export (runs/\S+|data/\S+) .*",
        # The model is the shipped one by now, and so is its data set; to fit an estimator takes minutes.
        shortened=((r"--dataset\n[^\n]+", ""), (r"--sensors", "")),
        slow=True,
        instead=("bundle", 3),
    ),
    Run(
        form=r"stillwake record \S+ .*|stillwake record \S+",
        shortened=tuple((rf"--{name}\n\d+", "") for name in ("training", "chirp", "uncontrolled")),
        # As long as training needs.
        added="--training 100 --chirp 85 --uncontrolled 40 --workers 1",
        slow=True,
    ),
    Run(form=r"stillwake develop re1000\.npz .*", added="--duration 1", slow=True),
    # On the mesh of the runs here.
    Run(form=r"stillwake develop start_re400\.npz .*", added="--duration 1 --set flow.refinement=0.4", slow=True),
    Run(form=r"stillwake picture mean .*", shortened=((r"--duration\n50", ""),), added="--duration 1", slow=True),
    # Control begins at 7 t_c.
    Run(form=r"stillwake animate .*--film", added="--duration 8", slow=True),
    Run(
        form=r"stillwake animate .*",
        shortened=((r"--duration\n25", ""), (r"--every\n3", "")),
        added="--duration 1",
        slow=True,
    ),
    Run(form=r"stillwake export --c \S+", slow=True),
    Run(form=r"stillwake mcu( runs/(own_c|ecu_c))?", slow=True),
)
