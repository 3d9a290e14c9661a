"""The controller program of a trained model, without PyTorch.

The slim encoder (`slim.`) becomes the program's encoder; the teacher on all sensors (`encoder.`) stays behind. So do
the wide dynamics and decoder where the model holds slim ones (`slim_dynamics.`, `slim_decoder.`).
"""

from contract.config.controller import MpcConfig
from contract.model.model_folder import SLIM, ModelFolder
from export.program.controller_program import ControllerProgram


def program_of(model: ModelFolder, mpc: MpcConfig) -> ControllerProgram:
    """The controller with these optimiser settings; raises ExportError if the weights do not fit."""
    about = model.description
    return ControllerProgram.from_state(
        encoder=model.network(SLIM),
        dynamics=model.deployed("dynamics"),
        decoder=model.deployed("decoder"),
        scaling=about.scaling.of_sensors(about.layout.indices(about.sensors)),
        mpc=mpc,
        action_limit=about.config.flow.action_limit,
        sensors=about.sensors,
        encoder_rows=about.config.model.window,
        prior=model.prior,
    )
