"""What rounding a trained model's weights to int8 changes of its plans: to nearest, and with error feedback.

    python -m benchmarks rounding --model DIR [--model DIR ..] [--json FILE]

Both kinds answer the gate's windows of the chirp, and as many of the last episode recorded under a controller, from the
float program's warm start (`export.gates.quantisation`). Error feedback is calibrated on windows of the latter, too;
the chirp is new to it.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from benchmarks.common.command_line import Dataset, JsonFile, console, save
from benchmarks.controller.situations import choose_episode
from contract.config.loading import load_config
from contract.model import model_folder
from contract.recording import dataset
from contract.results import versions
from contract.shipped import RECORDING
from export.gates.quantisation import compare_quantised
from export.int8.calibrate import rounded_on
from export.int8.rounded_program import rounded_to_nearest
from export.program.from_training import program_of
from export.program.recorded_windows import recorded_windows
from export.release.pipeline import GATE_WINDOWS, calibration_windows


def main(
    models: Annotated[list[Path], typer.Option("--model", help="Model folder by `stillwake train`; repeatable.")],
    json_file: JsonFile = None,
    data: Dataset = RECORDING,
) -> None:
    """Compare, print a table."""
    recording = dataset.read(data)
    rows = [row for model in models for row in of_model(model, recording)]
    table = Table("widths", "rounding", "episode", "rms action error", "mean cost gap", "largest cost gap")
    for row in rows:
        figures = (row["rms_action_error"], row["mean_cost_gap"], row["max_cost_gap"])
        table.add_row(row["widths"], row["rounding"], row["episode"], *(f"{value:.2e}" for value in figures))
    console.print(table)
    save(json_file, figures=rows, facts={"versions": versions("numpy")})


def of_model(model: Path, recording: dataset.Dataset) -> list[dict[str, Any]]:
    """Both roundings of a model on both episodes."""
    trained = model_folder.read(model)
    program = program_of(trained, load_config().mpc)
    calibration = calibration_windows(program, recording.with_role("train"))
    kinds = {"nearest": rounded_to_nearest(program), "error feedback": rounded_on(program, calibration)}
    dynamics, decoder = program.dynamics.hidden.weight.shape[0], program.decoder.input.weight.shape[0]
    return [
        {
            "widths": f"{dynamics}/{decoder}",
            "weights_sha256": trained.weights_sha256,
            "rounding": kind,
            "episode": episode.name,
            **asdict(compare_quantised(program, rounded.program, recorded_windows(program, episode, GATE_WINDOWS))),
        }
        for episode in (recording.with_role("test")[0], choose_episode(recording))
        for kind, rounded in kinds.items()
    ]
