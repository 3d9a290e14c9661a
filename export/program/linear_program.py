"""A linear controller as data: an autoregressive model, a state feedback, and nothing else."""

from dataclasses import dataclass, replace

import numpy as np

from contract.arrays import Array
from contract.config.controller import MpcConfig
from contract.controller.interface import Sizes
from contract.errors import ExportError
from contract.model.linear_model_folder import LinearModelFolder
from contract.release.manifest import Scaling


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearProgram:
    """Everything that a lowering needs to know. A program that exists is consistent.

    With p differences y of 2p sensors, first minus second of each pair, a history is L rows (y_k, a_k), oldest first.

    Attributes:
        model: (p + 1, L, p + 1), from the history up to a_k to y_{k+1} and Cl_{k+1}; Cp and U_inf W.
        gain: (L, p + 1), a_k = clip(gain . history); the last entry, of a_k itself, is 0.
        scaling: of the sensors, the action and the forces where the model was identified. Its mean Cd is the predicted
            drag: the model is odd in the mirror image, drag is even.
        mpc: horizon H, drag reference and default cost weights. No optimiser runs: its iterations and learning rate
            mean nothing here.
        action_limit: bound on |a|, in U_inf W.
        sensors: names in the order of the window's columns.
    """

    model: Array
    gain: Array
    scaling: Scaling
    mpc: MpcConfig
    action_limit: float
    sensors: tuple[str, ...]

    def __post_init__(self) -> None:
        columns = self.pairs + 1
        if len(self.sensors) < 2 or len(self.sensors) % 2 or len(set(self.sensors)) != len(self.sensors):
            raise ExportError(f"sensors {', '.join(self.sensors)}: must be pairs of different ones")
        if self.gain.shape != (self.window, columns) or self.model.shape != (columns, self.window, columns):
            raise ExportError(
                f"model {self.model.shape}, gain {self.gain.shape}: must be "
                f"({columns}, L, {columns}) and (L, {columns})"
            )
        if self.window < 2:
            raise ExportError(f"window = {self.window}: a linear controller has at least 2 rows of memory")
        if not (np.isfinite(self.model).all() and np.isfinite(self.gain).all()):
            raise ExportError("model or gain: a number is not finite")
        if self.gain[-1, -1] != 0.0:
            raise ExportError(f"gain: {self.gain[-1, -1]:g} on the action that it decides: must be 0")
        if not (np.isfinite(self.action_limit) and self.action_limit > 0):
            raise ExportError(f"action_limit = {self.action_limit}: must be positive and finite")

    @classmethod
    def of(cls, model: LinearModelFolder, mpc: MpcConfig) -> "LinearProgram":
        """The controller of a stored model with these settings, of which the iterations become 1: there are none."""
        about = model.description
        return cls(
            model=model.model,
            gain=model.gain,
            scaling=about.scaling,
            mpc=replace(mpc, iterations=1),
            action_limit=about.config.flow.action_limit,
            sensors=about.sensors,
        )

    @property
    def window(self) -> int:
        """L, control steps of memory."""
        return int(self.gain.shape[0])

    @property
    def pairs(self) -> int:
        """p, differences."""
        return len(self.sensors) // 2

    @property
    def sizes(self) -> Sizes:
        """The sizes of the inputs and outputs of a control step."""
        return Sizes(window=self.window, sensors=len(self.sensors), horizon=self.mpc.horizon)

    @property
    def products(self) -> int:
        """Multiply-adds of a control step: model and gain at every step of the horizon."""
        return self.mpc.horizon * (self.model.size + self.gain.size)
