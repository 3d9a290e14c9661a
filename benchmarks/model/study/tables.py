"""The tables of the model's study, from `results/model.json`."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common.markdown import read, table

_HEADS: Final = ("R2 Cd", "R2 Cl", "L1/sigma Cd", "L1/sigma Cl")
_LOOP_HEADS: Final = ("less drag in the loop", "mean abs Cl there")
_ERRORS: Final = tuple((force, kind) for kind in ("r2", "l1_over_sigma") for force in ("drag", "lift"))


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    found = read(results / "model.json")["figures"]
    return {
        "accuracy": accuracy(found),
        "bands": bands(found["bands"]),
        "unrolls": unrolls(found["unrolls"]),
        "latents": latents(found["seeds"]),
        "stability": stability(found["seeds"]),
        "counts": counts(found["counts"]),
        "without": without(found),
        "methods": methods(found),
        "noise": noise(found["disturbed"]),
        "single": single(found["disturbed"]),
        "widths": widths(found),
        "stream": stream(found["stream"]),
    }


def accuracy(found: Mapping[str, Any]) -> str:
    """The paper's figures beside ours, mean and range over the seeds."""
    lines: list[tuple[object, ...]] = [("paper, 90 sensors", 0.94, 0.96, 0.19, 0.15, 0.76, 0.81)]
    for label, rows in (
        ("90 sensors", [seed["metrics"]["teacher"] for seed in found["seeds"]]),
        ("4 sensors by SHAP, the paper's choice", [seed["metrics"]["slim"] for seed in found["seeds"]]),
        ("4 sensors by greedy selection under noise, the release's", found["hardened"]),
    ):
        columns = [[row[force][kind] for row in rows] for force, kind in _ERRORS]
        columns += [[row["rollout"][-1][force] for row in rows] for force in ("drag", "lift")]
        lines.append((f"{label}: mean of {len(rows)} seeds", *(f"{np.mean(column):.3f}" for column in columns)))
        lines.append(("lowest to highest", *(f"{min(column):.3f} to {max(column):.3f}" for column in columns)))
    return table(("", *_HEADS, "h = 25 Cd", "h = 25 Cl"), lines)


def unrolls(rows: Sequence[Mapping[str, Any]]) -> str:
    paper = {3: (0.83, 0.87), 5: (0.76, 0.81), 10: (0.81, 0.86), 25: (0.79, 0.86)}
    lines = []
    for row in rows:
        at = {item["horizon"]: item for item in row["rollout"]}
        grown = [f"{at[h]['drag']:.2f} / {at[h]['lift']:.2f}" for h in (1, 5, 10, 25, 50)]
        pair = "{:.2f} / {:.2f}".format(*paper[row["unroll"]])
        lines.append((row["unroll"], *_errors(row), *grown, pair, f"{row['cpu_minutes']:.1f}"))
    ahead = tuple(f"h = {h}" for h in (1, 5, 10, 25, 50))
    return table(("k", *_HEADS, *ahead, "paper, h = 25", "CPU minutes"), lines)


def bands(found: Mapping[str, Any]) -> str:
    lines: list[tuple[object, ...]] = [
        (f"{row['from']:.2f} to {row['to']:.2f}", *(f"{error:.2f}" for error in row["error"])) for row in found["bands"]
    ]
    lines.append(("training waveform", *(f"{error:.2f}" for error in found["training"])))
    return table(("frequency of the forcing, 1/t_c", "L1/sigma Cd at h = 25", "L1/sigma Cl at h = 25"), lines)


def latents(seeds: Sequence[Mapping[str, Any]]) -> str:
    lines = []
    for seed in seeds:
        covariance = np.array(seed["latent_covariance"])
        std = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(std, std)
        off = np.abs(correlation[~np.eye(len(std), dtype=bool)])
        lines.append((seed["seed"], " ".join(f"{value:.2f}" for value in std), off.mean(), off.max()))
    return table(("seed", "standard deviation of each latent", "mean abs correlation", "largest"), lines)


def stability(seeds: Sequence[Mapping[str, Any]]) -> str:
    lines = []
    for seed in seeds:
        ranking = seed["ranking"]
        row: list[object] = [seed["seed"], ", ".join(seed["sensors"])]
        for size, same in ranking["stable"].items():
            differing = ranking.get("differences", {}).get(size, {})
            named = ", ".join(f"{name} {share:.0%}" for name, share in differing.items())
            row.append("identical" if same else named or "differ")
        lines.append(row)
    sizes = list(seeds[0]["ranking"]["stable"])
    return table(("seed", "best four", *(f"top {size}" for size in sizes)), lines)


def counts(rows: Sequence[Mapping[str, Any]]) -> str:
    lines = [(len(row["sensors"]), *_errors(row), *_ahead(row)) for row in rows]
    return table(("sensors", *_HEADS, "h = 25 Cd", "h = 25 Cl"), lines)


def without(found: Mapping[str, Any]) -> str:
    whole = next(row for row in found["counts"] if len(row["sensors"]) == 4)
    lines = [("none", *_errors(whole)), *((row["removed"], *_errors(row)) for row in found["without"])]
    return table(("left out", *_HEADS), lines)


def methods(found: Mapping[str, Any]) -> str:
    lines = []
    for choice in found["choices"]:
        rows = [row for row in found["methods"] if row["method"] == choice["method"]]
        columns = [[row[force][kind] for row in rows] for force, kind in _ERRORS]
        cells = (f"{np.mean(column):.3f} ± {np.std(column, ddof=1):.3f}" for column in columns)
        loop = _loop(found, choice["method"])
        seconds = "" if choice["cpu_seconds"] is None else f"{choice['cpu_seconds']:.1f}"
        lines.append((choice["method"], ", ".join(choice["sensors"]), *cells, seconds, *_closed(loop)))
    ours = found["hardened"][0]
    name, chosen = "greedy, chosen and distilled under noise, in full", ", ".join(ours["sensors"])
    lines.append((name, chosen, *_errors(ours), "", *_closed(_loop(found, "hardened"))))
    return table(("method", "sensors", *_HEADS, "CPU seconds", *_LOOP_HEADS), lines)


def noise(found: Mapping[str, Any]) -> str:
    pairs = zip(found["shap"]["noise"], found["hardened"]["noise"], strict=True)
    lines = [(f"{one['level']:.0%}", *_errors(one), *_errors(two)) for one, two in pairs]
    heads = (f"{who}: {head}" for who in ("SHAP", "release") for head in _HEADS)
    return table(("noise", *heads), lines)


def single(found: Mapping[str, Any]) -> str:
    """The release's sensors: the worst for each fault, and all of them for a dead one."""
    lines: list[tuple[object, ...]] = []
    rows = found["hardened"]["single"]
    for row in rows:
        if row["fault"] == "dead":
            lines.append((f"{row['sensor']} dead", *_errors(row)))
    for fault in ("bias", "drift"):
        for level in sorted({row["level"] for row in rows if row["fault"] == fault}):
            alike = [row for row in rows if (row["fault"], row["level"]) == (fault, level)]
            worst = max(alike, key=lambda row: float(row["drag"]["l1_over_sigma"]))
            lines.append((f"{fault} {level:.0%}, worst of four: {worst['sensor']}", *_errors(worst)))
    larger = found["amplitude"]
    for who, label in (("teacher", "90 sensors"), ("slim", "4 sensors")):
        lines.append((f"chirp at amplitude {larger['limit']:g}, {label}", *_errors(larger[who])))
    return table(("", *_HEADS), lines)


def widths(found: Mapping[str, Any]) -> str:
    seed = found["seeds"][0]["metrics"]["slim"]
    released = _closed(_loop(found, "full"))
    lines: list[tuple[object, ...]] = [("256/128, as trained", *_errors(seed), *_steps(seed), "", *released)]
    for row in found["widths"]:
        name = f"{row['dynamics']}/{row['decoder']}"
        loop = next((item for item in found["loops"] if item["variant"] == name.replace("/", "_")), None)
        closed = _closed(loop) if loop is not None else ("", "")
        lines.append((name, *_errors(row), *_steps(row), f"{row['cpu_minutes']:.1f}", *closed))
    return table(("dynamics/decoder", *_HEADS, "h = 5", "h = 10", "h = 25", "CPU minutes", *_LOOP_HEADS), lines)


def stream(found: Mapping[str, Any]) -> str:
    lines = [(row["case"], row["latent"], *_errors(row), *_ahead(row)) for row in found["rows"]]
    return table(("", "latents, L1/sigma", *_HEADS, "h = 25 Cd", "h = 25 Cl"), lines)


def _loop(found: Mapping[str, Any], variant: str) -> Mapping[str, Any]:
    loop: Mapping[str, Any] = next(item for item in found["loops"] if item["variant"] == variant)
    return loop


def _closed(loop: Mapping[str, Any]) -> Iterator[str]:
    if loop.get("refused"):
        yield from ("export refused", "")
        return
    yield f"{loop['reduction_percent']:.1f} %"
    yield f"{loop['abs_Cl_controlled']:.2f}"


def _errors(row: Mapping[str, Any]) -> Iterator[str]:
    for force, kind in _ERRORS:
        yield f"{row[force][kind]:.3f}"


def _ahead(row: Mapping[str, Any]) -> Iterator[str]:
    for force in ("drag", "lift"):
        yield f"{row['rollout'][-1][force]:.3f}"


def _steps(row: Mapping[str, Any]) -> Iterator[str]:
    for item in row["rollout"]:
        yield f"{item['drag']:.2f} / {item['lift']:.2f}"
