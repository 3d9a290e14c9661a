"""The tables of the ways to fewer operations."""

from pathlib import Path

from benchmarks.common.markdown import read, table


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    found = read(results / "operations.json")["figures"]
    rows = []
    for row in found["roads"]:
        closed = row.get("loop", {})
        drag = closed.get("reduction_percent")
        rows.append(
            (
                row["name"],
                row["iterations"],
                *(f"{row[name]:.1f}" for name in ("gap", "gap_p95")),
                f"{row['multiply_accumulates'] / 1e6:.2f}",
                f"{row['modelled_ms_480']:.1f}",
                None if drag is None else f"{drag:.2f} %",
                *(f"{closed[name]:.3f}" if closed else None for name in ("abs_Cl_controlled", "rms_action")),
            )
        )
    heads = ("road", "iterations", "gap, %", "95th percentile", "M MAC", "ms", "less drag", "mean abs Cl", "rms action")
    encoder = found["encoder"]
    streamed = (
        ("encoder, a window, MAC", encoder["window"]),
        ("streamed, MAC", encoder["streamed"]),
        ("of the step's products", f"{100.0 * encoder['saved_share']:.0f} %"),
        ("saved, ms", f"{encoder['saved_ms_480']:.2f} of {encoder['step_ms_480']:.2f}"),
    )
    return {"operations": table(heads, rows), "operations_encoder": table(("", ""), streamed)}
