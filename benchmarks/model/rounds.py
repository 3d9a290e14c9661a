"""Data where the controller lives: rounds of recording under the newest bundle and training again (DAgger).

    python -m benchmarks rounds [--json FILE] [--rounds 3]

Round 0 is trained on the paper's data set alone. Each further round adds episodes recorded under the bundle before it,
with exploration, and trains again from scratch on everything. Other episodes under the first bundle are held out, and
every round's model predicts them, and the chirp. Every step is a `stillwake` command; finished parts stay in
`runs/rounds`, so that a measurement of hours can be stopped and continued.
"""

import shutil
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from benchmarks.common.command_line import JsonFile, Parts, console, save
from benchmarks.common.commands import LOOP, stillwake
from benchmarks.common.markdown import read
from benchmarks.common.paper_data import paper_file
from contract import sensors
from contract.model.model_folder import DESCRIPTION
from contract.recording import dataset
from contract.recording.dataset import Role
from contract.results import versions
from train import model_store
from train.distillation.evaluate import evaluate
from train.samples.rows import prepare

_COLUMNS: Final = ("steps", "chirp R2", "chirp h=25", "controlled R2", "controlled h=25", "Cd", "reduction_percent")


def main(
    json_file: JsonFile = None,
    rounds: Annotated[int, typer.Option(help="Rounds of recording after the first training.", min=1)] = 3,
    episodes: Annotated[int, typer.Option(help="Episodes a round.", min=1)] = 4,
    steps: Annotated[int, typer.Option(help="Control steps an episode.", min=100)] = 1100,
    parts: Parts = Path("runs/rounds"),
) -> None:
    """Run the rounds and print a table."""
    parts.mkdir(parents=True, exist_ok=True)
    data = parts / "data_0.h5"
    if not data.exists():
        shutil.copyfile(paper_file(parts), data)
    for number in range(rounds + 1):
        bundle = _release(parts, number, data)
        if number < rounds:
            data = _recorded(parts / f"data_{number + 1}.h5", data, bundle, episodes, steps, role="train")
    first = parts / "data_0.h5", parts / "bundle_0"
    held_out = _recorded(parts / "held_out.h5", *first, 2, steps, role="controlled")
    rows = [_row(parts, number, held_out) for number in range(rounds + 1)]
    table = Table("round", *_COLUMNS)
    for row in rows:
        chirp, controlled = row["chirp"], row["controlled"]
        table.add_row(
            str(row["round"]),
            str(row["controlled_steps"]),
            *(_pair(part, key) for part in (chirp, controlled) for key in ("r2", "rollout")),
            f"{row['loop']['Cd_controlled']:.4f}",
            f"{row['loop']['reduction_percent']:.1f}",
        )
    console.print(table)
    facts = {"episodes": episodes, "steps": steps, "versions": versions("stillwake", "torch", "onnxruntime")}
    save(json_file, figures=rows, facts=facts)


def _release(parts: Path, number: int, data: Path) -> Path:
    """Model, bundle and closed loop of a round; what is there already is kept."""
    model, bundle, run = (parts / f"{name}_{number}" for name in ("model", "bundle", "run"))
    if not (model / DESCRIPTION).is_file():
        # Sensors are drilled into the body once: later rounds keep the first one's.
        fixed = ("--sensors", ",".join(model_store.load(parts / "model_0").sensors)) if number else ()
        stillwake("train", model, "--dataset", data, *fixed)
    if not bundle.exists():
        stillwake("export", model, bundle, "--dataset", data, "--name", f"truck-wake-round-{number}")
    if not run.with_suffix(".json").exists():
        stillwake("run", run, "--overwrite", "--bundle", bundle, "--json", run.with_suffix(".json"))
    return bundle


def _recorded(output: Path, before: Path, bundle: Path, episodes: int, steps: int, *, role: Role) -> Path:
    """The data set `before` with a round added; recorded aside, so that a file of that name is a whole one."""
    if not output.exists():
        aside = output.with_suffix(".recording.h5")
        if not aside.exists():
            shutil.copyfile(before, aside)
        options = ("--episodes", episodes, "--controlled", steps, "--role", role)
        stillwake("record", aside, "--under", bundle, *options)
        aside.replace(output)
    return output


def _row(parts: Path, number: int, held_out: Path) -> dict[str, Any]:
    trained = model_store.load(parts / f"model_{number}")
    chosen = sensors.TRUCK.indices(trained.sensors)
    found: dict[str, Any] = {}
    roles: dict[str, Role] = {"chirp": "test", "controlled": "controlled"}
    for name, role in roles.items():
        episodes = dataset.read(held_out).with_role(role)
        rows = prepare(episodes, trained.scaling, mirrored=False).with_sensors(chosen)
        found[name] = evaluate(trained.slim, trained.deployed, rows).as_tree()
    loop = read(parts / f"run_{number}.json")["figures"]
    recorded = dataset.read(parts / f"data_{number}.h5").episodes
    return {
        "round": number,
        "controlled_steps": sum(len(item) for item in recorded if item.provenance["forcing_signal"] == "controlled"),
        "sensors": list(trained.sensors),
        **found,
        "loop": {name: loop[name] for name in LOOP},
    }


def _pair(part: dict[str, Any], key: str) -> str:
    if key == "rollout":
        last = part["rollout"][-1]
        return f"{last['drag']:.2f} / {last['lift']:.2f}"
    return f"{part['drag'][key]:.3f} / {part['lift'][key]:.3f}"
