"""The tables of `docs/controller.md` on int8 weights, and on the loop with each lowering."""

from pathlib import Path
from typing import Final

from benchmarks.common.markdown import read, table

_NAMES: Final = {"onnx": "ONNX Runtime", "c": "C library"}


def tables(results: Path) -> dict[str, str]:
    """Every table by its name on the page, which is the name of its file."""
    loops = {name: loop(results / f"{name}.json") for name in ("controller_loop", "controller_loop_narrow")}
    return loops | {"rounding": rounding(results / "rounding.json")}


def rounding(path: Path) -> str:
    """What int8 weights change of a plan, to nearest and with error feedback."""
    names = ("widths", "rounding", "episode", "rms_action_error", "mean_cost_gap", "max_cost_gap")
    rows = [[row[name] for name in names] for row in read(path)["figures"]]
    return table(("widths", "rounding", "episode", "rms action error", "mean cost gap", "largest cost gap"), rows)


def loop(path: Path) -> str:
    """Drag, lift and action of the four loops, and what each changes of the first one's reduction."""
    rows = [
        (
            f"{_NAMES[row['lowering']]}, {row['precision']}",
            f"{row['reduction_percent']:.2f} %",
            f"{row['points']:+.2f}",
            *(row[name] for name in ("abs_Cl_controlled", "mean_Cl_controlled", "rms_action")),
            f"{row['mpc_ms_p50']:.2f} / {row['mpc_ms_p99']:.2f}",
        )
        for row in read(path)["figures"]
    ]
    heads = ("", "less drag", "points", "mean abs Cl", "mean Cl", "rms action", "ECU step, ms p50 / p99")
    return table(heads, rows)
