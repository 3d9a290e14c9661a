"""The tables of the model: its study, the rounds under a controller, and what training costs."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from benchmarks.common.markdown import read, table
from benchmarks.model.study import tables as study_tables


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    return study_tables.tables(results) | {
        "rounds": rounds(results),
        "training": training(results),
        "distilled": distilled(results),
    }


def rounds(results: Path) -> str:
    lines = []
    for row in read(results / "rounds.json")["figures"]:
        loop = row["loop"]
        parts = (row["chirp"], row["controlled"])
        fit = (f"{part['drag']['r2']:.3f} / {part['lift']['r2']:.3f}" for part in parts)
        ahead = (f"{part['rollout'][-1]['drag']:.2f} / {part['rollout'][-1]['lift']:.2f}" for part in parts)
        pairs = [cell for pair in zip(fit, ahead, strict=True) for cell in pair]
        closed = (f"{loop['Cd_controlled']:.4f}", f"{loop['reduction_percent']:.1f} %")
        lines.append((row["round"], row["controlled_steps"], *pairs, *closed, *_side(loop)))
    heads = ("R2, chirp", "h = 25, chirp", "R2, controlled", "h = 25, controlled", "Cd", "less drag")
    return table(("round", "steps added", *heads, "mean abs Cl", "mean Cl", "rms action"), lines)


def distilled(results: Path) -> str:
    lines = []
    for row in read(results / "distilled.json")["figures"]:
        widths = row["widths"] or (256, 128)
        taught = {None: "as trained", 0.0: "roll-outs"}.get(row["slope_weight"], "roll-outs and slopes")
        lines.append(
            (
                f"{widths[0]}/{widths[1]}",
                taught,
                f"{row['iterations']} x {row['learning_rate']:g}",
                f"{row['reduction_percent']:.2f} %",
                f"{row['least_reduction_percent']:.2f} to {row['most_reduction_percent']:.2f}",
                f"{row['abs_Cl_controlled']:.3f}",
                f"{row['rms_action']:.4f}",
            )
        )
    heads = (
        "dynamics/decoder",
        "taught",
        "iterations",
        "less drag",
        "from phase to phase",
        "mean abs Cl",
        "rms action",
    )
    return table(heads, lines)


def training(results: Path) -> str:
    found = read(results / "training.json")["figures"]
    lines = [
        ("straightforward: every window read for itself by torch.nn.LSTM", found["straightforward_ms"]),
        ("shared windows, own backward pass (`train.networks.recurrence`)", found["shared_ms"]),
        ("of it the LSTM", found["lstm_ms"]),
        ("arithmetic floor of the step", found["step_floor_ms"]),
        ("arithmetic floor of the LSTM", found["lstm_floor_ms"]),
        ("LSTM read as a stream, as many latents", found["stream_lstm_ms"]),
    ]
    return table(("one step, batch of 512 samples, one thread", "ms"), [(name, f"{ms:.1f}") for name, ms in lines])


def _side(loop: Mapping[str, float]) -> Iterator[str]:
    for name in ("abs_Cl_controlled", "mean_Cl_controlled", "rms_action"):
        yield f"{loop[name]:.3f}"
