"""The commands that lower a trained model: to a release bundle and a C library, and onto an emulated Cortex-M7."""

from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from contract.config.loading import load_config
from contract.release.signing import public_key, read_private_key
from contract.results import write_result
from stillwake.settings import settings
from stillwake.terminal import ConfigFile, JsonFile, Overrides, console
from wake.shipped import RECORDING


def export(
    model: Annotated[Path, typer.Argument(help="Model directory written by `train`.")],
    output: Annotated[Path, typer.Argument(help="Bundle directory, or .zip, to write.")],
    precision: Annotated[str, typer.Option(help="int8 (weights) or float32.")] = "int8",
    name: Annotated[str, typer.Option(help="Name of the release.")] = "truck-wake",
    dataset: Annotated[Path | None, typer.Option(help="Recording the gates are run on; default: shipped.")] = None,
    c_folder: Annotated[Path | None, typer.Option("--c", help="Also write the C99 library into this folder.")] = None,
    key: Annotated[Path | None, typer.Option(help="Sign the bundle with this private key (`bundle keygen`).")] = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Lower a trained model to one ONNX graph of a control step and pack a release bundle.

    The MPC settings come from the configuration. Nothing is written unless the graph agrees with the reference, and so
    does the C library where one is asked for.
    """
    from export.release.pipeline import export_all, gate_figures

    signing_key = None if key is None else read_private_key(key)
    done = export_all(
        model,
        output,
        precision=precision,
        name=name,
        recording=RECORDING if dataset is None else dataset,
        config=load_config(config_file, overrides),
        c_folder=c_folder,
        created=date.today(),
        key=signing_key,
    )
    table = Table("gate", "measured")
    for title, value in gate_figures(done):
        table.add_row(title, f"{value:.3g}" if isinstance(value, float) else str(value))
    console.print(table)
    signed = "unsigned" if signing_key is None else f"signed by key {public_key(signing_key).fingerprint}"
    size = f"controller.onnx {done.graph.controller_bytes / 1024:.0f} KiB"
    console.print(f"wrote {output}: {precision}, {size}, {signed}", soft_wrap=True)
    if done.library is not None:
        console.print(f"wrote {c_folder}: C99, {precision}, {done.library.workspace_bytes / 1024:.0f} KiB of workspace")


def mcu(
    library: Annotated[Path, typer.Argument(help="Folder written by `export --c`.")],
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Compile the C library for a Cortex-M7, replay its recorded rows on an emulated one, compare with this host.

    The last lines say whether a step fits into the control period of the operating point.
    """
    from firmware_sim.mcu.measure import measure_folder
    from firmware_sim.mcu.verdict import period_ms, verdicts

    config = settings("mcu", config_file, overrides, uses=["operating_point", "flow.control_period"]).config
    found = measure_folder(library)
    table = Table("one control step on a Cortex-M7", "")
    for name, value in (*found.rows(), *verdicts(found.modelled_ms, period_ms(config))):
        table.add_row(name, value)
    console.print(table)
    if json_file is not None:
        write_result(
            json_file,
            figures=asdict(found),
            facts={"library": str(library), "period_ms": period_ms(config)},
            on=date.today(),
        )
