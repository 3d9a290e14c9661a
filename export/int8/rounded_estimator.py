"""The sensor estimator's matrices in int8, one scale an output, rounded to nearest as `export.int8.nearest` does."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from contract.controller.estimator import EstimatorNetwork
from export.int8.nearest import Int8Matrix, quantise_matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class RoundedEstimator:
    """What a bundle holds.

    Attributes:
        network: with the weights that the integers stand for.
        matrices: the integers of each layer.
    """

    network: EstimatorNetwork
    matrices: Sequence[Int8Matrix]


def rounded_estimator(network: EstimatorNetwork) -> RoundedEstimator:
    """A network's; of one that is rounded already the integers stay."""
    matrices = [quantise_matrix(weight) for weight, _ in network.layers]
    layers = [
        (matrix.dequantised().astype(float), bias) for matrix, (_, bias) in zip(matrices, network.layers, strict=True)
    ]
    return RoundedEstimator(network=replace(network, layers=layers), matrices=matrices)
