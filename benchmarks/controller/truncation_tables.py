"""The tables of the truncation of the optimiser."""

from pathlib import Path

from benchmarks.common.markdown import read, table


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    figures = read(results / "truncation.json")["figures"]
    names = ("gap", "gap_worst", "action_error", "action_error_worst")
    iterations = [(row["start"], row["iterations"], *(row[name] for name in names)) for row in figures["iterations"]]
    rates = [
        (
            "the optimum" if row["learning_rate"] is None else f"{row['learning_rate']:g}",
            *(row[name] for name in ("gap", "action_error", "roughness", "roughness_noisy", "noise_in_action")),
        )
        for row in figures["learning_rates"]
    ]
    starts = figures["starts"]
    spread = [
        ("deviation of the cost, of the optimum's", starts["deviation_of_cost"]),
        ("deviation of the cost, of the gain", starts["deviation_of_gain"]),
        ("lowest to highest cost, of the gain", starts["range_of_gain"]),
        ("starts that end within 1 % of the gain from the best", starts["near_share"]),
        ("range of the first action among those, of the limit", starts["first_action_range_near"]),
        ("Adam's best above the lowest cost found, of the gain", figures["optimisers"]["scattered_adam_gap"]),
        ("L-BFGS-B from zero and warm above it, of the gain", figures["optimisers"]["quasi_newton_gap"]),
    ]
    count = f"mean {starts['valleys']:.3g}, at most {starts['valleys_most']:g}"
    return {
        "truncation": table(
            ("start", "iterations", "gap, %", "largest", "first action off, % of limit", "largest"),
            [row for start in ("cold", "warm") for row in iterations if row[0] == start],
        ),
        "starts": table(
            ("random starts, mean over snapshots", ""),
            [*((label, f"{value:.3g} %") for label, value in spread), ("different minima", count)],
        ),
        "rates": table(
            (
                "learning rate",
                "gap, %",
                "first action off, %",
                "step to step, %",
                "step to step with noise, %",
                "rms of what noise changes, %",
            ),
            rates,
        ),
    }
