"""Run the study of the model, or what is left of it, write its figures and draw its pictures.

    python -m benchmarks model [--json results/model.json] [--parts runs/model_study]

Hours on two cores. Finished parts stay in the folder, so that a stopped study continues. `make tables` fills the
tables of the documents from the figures.
"""

from concurrent.futures import as_completed
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.common.command_line import Parts, progress, save
from benchmarks.common.pictures import draw
from benchmarks.common.workers import process_pool
from benchmarks.model.study import figures, network_figures
from benchmarks.model.study.lab import Lab, digest, episodes, open_lab, quiet
from benchmarks.model.study.parts import COUNTS, LOOPS, SEEDS, UNROLLS, WIDTHS, Part, run, stages
from contract.config.loading import load_config, to_tree
from contract.results import versions
from stillwake.console.terminal import ConfigFile, Overrides, progress_bar
from train.selection.correlation import correlation
from train.selection.methods import METHODS


def main(
    json_file: Annotated[Path, typer.Option("--json", help="Write the figures here.")] = Path("results/model.json"),
    parts: Parts = Path("runs/model_study"),
    workers: Annotated[int, typer.Option(help="Parts side by side, a thread each.", min=1)] = 2,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Run every part that is missing, then write figures and pictures."""
    config = load_config(config_file, overrides)
    lab = open_lab(config, parts)
    with (
        progress_bar("parts", estimate_over=3600.0, console=progress) as bar,
        process_pool(workers, quiet) as pool,
    ):
        task = bar.add_task("parts", total=sum(len(stage) for stage in stages()), note="")
        for stage in stages():
            running = {pool.submit(run, lab, part): part for part in stage}
            for future in as_completed(running):
                future.result()
                bar.update(task, advance=1, note=running[future].name)
    save(json_file, figures=collected(lab), facts=facts(lab))
    draw({**figures.drawn(json_file), **network_figures.drawn(lab)}, json_file.resolve())


def collected(lab: Lab) -> dict[str, Any]:
    """All parts as one tree."""

    def found(kind: str, *arguments: object) -> Any:
        return run(lab, Part(kind=kind, arguments=arguments))

    return {
        "seeds": [found("model", seed) for seed in SEEDS],
        "counts": [found("count", number) for number in COUNTS],
        "without": [found("without", place) for place in range(len(lab.model().sensors))],
        "choices": [found("choice", method) for method in METHODS],
        "methods": [found("method", method, seed) for method in METHODS for seed in SEEDS],
        "unrolls": [found("unroll", steps) for steps in UNROLLS],
        "widths": [found("width", *widths) for widths in WIDTHS],
        "stream": found("stream"),
        "hardened": [found("hardened", seed) for seed in SEEDS],
        "bands": found("bands"),
        "loops": [found("loop", name) for name in LOOPS],
        "disturbed": found("disturbed"),
        "correlation": correlation(episodes("train"), lab.model().sensors).tolist(),
    }


def facts(lab: Lab) -> dict[str, Any]:
    packages = versions("stillwake", "torch", "numpy", "shap")
    return {"dataset_sha256": digest(), "config": to_tree(lab.config), "versions": packages}
