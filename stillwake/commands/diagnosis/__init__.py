"""The commands that communicate with an ECU over UDS, the diagnostic protocol."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from contract.config.vehicle import BusConfig

if TYPE_CHECKING:
    from can_bridge.tester.asking import Asking


@contextmanager
def asking(bus: BusConfig, access: Path | None = None) -> Iterator["Asking"]:
    """Open a tester's connection to the ECU on the bus. The access key is read from the file `access`; reading from the
    ECU needs no key. Raises BusError if the bus cannot be opened; KeyFileError if the file has no valid key."""
    from can_bridge.tester.asking import Asking
    from can_bridge.tester.transport import open_client
    from can_bridge.uds.security import AccessKey

    key = None if access is None else AccessKey.read(access).answer
    with open_client(bus) as client:
        yield Asking(client, key=key, clock=time.monotonic, sleep=time.sleep)
