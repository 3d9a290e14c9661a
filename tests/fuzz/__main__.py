"""Look for new ways through the receive path with atheris, which sees what of the code an input has reached:

    pip install atheris
    python -m tests.fuzz -max_total_time=300 -max_len=600

It stops at the first exception and leaves the input in a file `crash-...`; with that name as the only argument it runs
the one input again. Other options are libFuzzer's.
"""

import sys

import atheris  # type: ignore[import-untyped]

with atheris.instrument_imports(include=["tests.fuzz", "can_bridge", "msgpack", "can.message"]):
    from tests.fuzz.receive_path import follow

atheris.Setup(sys.argv, follow)
atheris.Fuzz()
