"""The sample folders of the C library, and its functions over arrays."""

import ctypes
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from ecu.in_c.host_library import CController
from examples import c_samples


@pytest.fixture(scope="session")
def samples(tmp_path_factory) -> Path:
    folder: Path = tmp_path_factory.mktemp("samples") / "c"
    with pytest.MonkeyPatch.context() as patch:
        # One build for the expected answers and for the known one.
        patch.setattr(c_samples, "CController", partial(CController, flags=("-O1", "-ffp-contract=off")))
        c_samples.main(folder)
    return folder


@pytest.fixture(scope="session")
def applied() -> Callable[..., Callable[..., np.ndarray]]:
    """Of a library with a shim of `c/`: one of its functions, by its number, over an array of this type."""

    def function(library: ctypes.CDLL, dtype: type[np.generic]) -> Callable[..., np.ndarray]:
        def apply(which: int, x: np.ndarray) -> np.ndarray:
            x = np.ascontiguousarray(x, dtype=dtype)
            y = np.empty_like(x)
            library.apply(which, len(x), ctypes.c_void_p(x.ctypes.data), ctypes.c_void_p(y.ctypes.data))
            return y.astype(np.float64)

        return apply

    return function
