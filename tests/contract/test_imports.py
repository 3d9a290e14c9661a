"""What a vehicle installs imports without anything that only the laboratory has."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CARRIED = ("contract", "can_bridge", "ecu")
"""What each of them may import of the others is the linter's: `banned-api` in their `ruff.toml`."""
LABORATORY = {"firmware_sim", "wake", "train", "export", "stillwake", "benchmarks"}
NOT_IN_THE_BASE_INSTALL = {
    "torch", "shap", "onnx", "safetensors", "numba", "scipy", "gymnasium", "matplotlib", "PIL", "threadpoolctl",
    "dask", "distributed", "unicorn", "capstone", "casadi", "h5py", "stillwake_data", "cantools", "msgpack", "serial",
    "asammdf", "mcap", "mcap_protobuf", "foxglove_schemas_protobuf", "google.protobuf",
}  # fmt: skip
OF_TESTS = {"e2e", "pytest", "hypothesis"}
OF_THE_COMMAND_LINE = {"typer", "rich"}


@pytest.mark.slow
def test_imports_nothing_the_vehicle_does_not_carry():
    # Data sets are the laboratory's: they need h5py.
    found = {path for room in CARRIED for path in (ROOT / room).rglob("*.py")}
    found -= set((ROOT / "contract" / "recording").rglob("*.py"))
    files = [path.relative_to(ROOT) for path in sorted(found)]
    modules = [".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in files]
    absent = sorted(NOT_IN_THE_BASE_INSTALL | OF_TESTS | OF_THE_COMMAND_LINE | LABORATORY)
    # None in sys.modules makes an import raise, also one that a library or a function tries.
    code = (
        # python-can warns by its logger of the interfaces that lack a package.
        "import logging, sys; logging.getLogger('can').addHandler(logging.NullHandler()); "
        f"sys.modules.update(dict.fromkeys({absent})); import {', '.join(modules)}"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (len(modules) > 100, result.stderr, result.returncode) == (True, "", 0)
