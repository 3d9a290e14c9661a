"""`controller.onnx` under ONNX Runtime, with the reference's arguments and results."""

from typing import Any

import numpy as np
import onnxruntime

from export.program.weights import Array
from export.reference.mpc import Solution
from export.to_onnx.control_step import OUTPUTS


class OnnxController:
    """A session on one thread, as on the ECU."""

    def __init__(self, model: bytes) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        # Errors only: the runtime warns that `weights`, being an input, cannot be folded. That is its purpose.
        options.log_severity_level = 3
        self._session: Any = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> Solution:
        """As `reference_mpc.control_step`, in float32; without weights the model's own default applies."""
        feed = {"window": window, "plan": plan, "free": free}
        if weights is not None:
            feed["weights"] = weights
        outputs = self._session.run(list(OUTPUTS), {name: value.astype(np.float32) for name, value in feed.items()})
        new_plan, forces, terms, cost = (np.asarray(value, dtype=np.float64) for value in outputs)
        return Solution(plan=new_plan, forces=forces, terms=terms, cost=float(cost))
