"""Write a small sample of each kind of C library, with random weights, for reading, compiling and debugging.

    python -m examples.c_samples build/c

This command writes the folders `build/c/float32` and `build/c/int8` in the same form as `stillwake export --c`. Each
folder also has a `compile_flags.txt` for editors that use clangd. While the samples are in `build/c`, such an editor
also finds all headers that the sources in `export/to_c/sources` include.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.c_folder import COMPILE_FLAGS, EXPECTED, RECORDED, rows_text, write_folder
from ecu.in_c.compiler import STANDARD
from ecu.in_c.host_library import CController
from examples.random_programs import random_program
from export.program.controller_program import random_windows
from export.to_c.builds import build_files
from export.to_c.library import c_library, documents, int8_library, replay, with_answer

MODEL = ModelConfig(latent=3, lstm_width=8, dynamics_width=16, decoder_width=8)
MPC = MpcConfig(horizon=8)


def main(folder: Annotated[Path, typer.Argument(help="Where to write the samples.")]) -> None:
    """Write a sample of the C library of each kind."""
    program = random_program(0, model=MODEL, mpc=MPC)
    windows = random_windows(program, 10)
    series = np.concatenate(windows[:2]).astype(np.float32).astype(np.float64)
    sliding = [series[k : k + program.window] for k in range(len(series) - program.window + 1)]
    flags = "".join(f"{flag}\n" for flag in STANDARD)
    others = {RECORDED: rows_text(series).encode(), COMPILE_FLAGS: flags.encode()}
    folder.mkdir(parents=True, exist_ok=True)
    libraries = {"float32": c_library(program), "int8": int8_library(program, windows)}
    for kind, library in libraries.items():
        # `program.sizes` is right for both kinds, because window, sensors and horizon are equal.
        controller = CController(library, program.sizes)
        answers = replay(controller, sliding, program.mpc.horizon)
        contents = with_answer(library, controller.known_answer()) | others | {EXPECTED: rows_text(answers).encode()}
        contents |= documents(library) | build_files(library)
        write_folder(folder / kind, contents)


if __name__ == "__main__":
    typer.run(main)
