import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HEAVY = {"torch", "onnx", "shap", "safetensors", "cantools", "e2e"}


@pytest.mark.parametrize("room", ["contract", "can_bridge"])
def test_imports_nothing_the_vehicle_does_not_carry(room):
    modules = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in (ROOT / room).rglob("[!_]*.py")]
    code = f"import sys, {', '.join(modules)}; sys.exit(', '.join({HEAVY} & set(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (len(modules) > 1, result.stderr) == (True, "\n")
