"""The names of `contract.differentiable` that the refinement uses."""

from contract.differentiable import DifferentiableFlow as DifferentiableFlow
from contract.differentiable import FlowState as FlowState
from contract.differentiable import Seen as Seen
