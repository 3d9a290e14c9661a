"""Compile the flow solver's kernels and their adjoint once, before two workers of the tests do so side by side.

python -m tests.compile_kernels
"""

from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from wake.truck.tape import Tape, no_weights
from wake.truck.truck_wake import TruckWake


def main() -> None:
    """A period there and back; numba keeps what it compiled beside the sources."""
    plant = TruckWake(FlowConfig(refinement=0.4, substeps=12), body=BodyConfig())
    tape = Tape(plant, 500.0)
    tape.advance(0.0)
    tape.back(no_weights(len(plant.layout)))


if __name__ == "__main__":
    main()
