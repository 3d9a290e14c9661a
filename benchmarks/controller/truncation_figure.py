"""Gap and action error against iterations and learning rate."""

from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.common.markdown import read


def draw(results: Path) -> Figure:
    """Left by iterations, cold and warm; right by learning rate, receding."""
    figures = read(results / "truncation.json")["figures"]
    figure = Figure(figsize=(9.0, 5.6), dpi=110, layout="constrained")
    grid = figure.subplots(2, 2, sharex="col")
    rates = [row for row in figures["learning_rates"] if row["learning_rate"] is not None]
    for line, (name, label) in zip(
        grid, (("gap", "cost gap, % of the gain"), ("action_error", "first action off, % of limit")), strict=True
    ):
        for start, colour in (("cold", "tab:blue"), ("warm", "tab:red")):
            rows = [row for row in figures["iterations"] if row["start"] == start]
            counts = [row["iterations"] for row in rows]
            line[0].plot(counts, [row[name] for row in rows], "o-", color=colour, markersize=4, label=start)
            line[0].plot(counts, [row[f"{name}_worst"] for row in rows], ":", color=colour, linewidth=1.0)
        line[1].plot(
            [row["learning_rate"] for row in rates], [row[name] for row in rates], "ko-", markersize=4, label=label
        )
        line[0].set_ylabel(label)
        for axes in line:
            axes.set_ylim(bottom=0.0)
            axes.grid(color="0.9")
    for name, label in (("roughness", "step to step"), ("roughness_noisy", "step to step, noisy sensors")):
        grid[1, 1].plot([row["learning_rate"] for row in rates], [row[name] for row in rates], "s--", ms=4, label=label)
    grid[0, 0].set_xscale("symlog", linthresh=1.0)
    grid[0, 0].set_xticks((0, 1, 2, 5, 10, 20, 50), labels=("0", "1", "2", "5", "10", "20", "50"))
    grid[0, 0].set_xlim(-0.3, 60.0)
    for axes, title in ((grid[0, 0], "mean over situations; dotted: largest"), (grid[0, 1], None)):
        axes.legend(title=title, loc="upper right", ncols=2, fontsize=8, title_fontsize=8)
    grid[0, 0].set_ylim(top=140.0)
    grid[1, 1].legend(fontsize=8)
    grid[0, 1].set_xscale("log")
    grid[1, 0].set_xlabel("iterations of Adam")
    grid[1, 1].set_xlabel("learning rate, receding")
    return figure
