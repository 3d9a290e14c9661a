"""The sequence of services that flashes a release, as the PDX file states it for authors of a flash job."""

from collections.abc import Iterator
from typing import Final

SEQUENCE: Final = """
session_extended
routine_preconditions
faults_off
disable_sending       kind=1
session_programming
seed_programming
key_programming       key=KEY
routine_erase         length=LENGTH sha256=SHA256
download              offset=OFFSET length=REST
transfer              counter=COUNTER data=BLOCK
exit
routine_check
routine_activate
reset_hard
session_programming
seed_programming
key_programming       key=KEY
routine_self_test
routine_confirm
session_default
"""
"""Services of `stillwake.odx-d` in their order, with arguments; `ARGUMENTS` explains the words in capitals."""
ARGUMENTS: Final = {
    "KEY": "key for the seed from the step before (seed_and_key.json)",
    "LENGTH": "size of the image in bytes",
    "SHA256": "SHA-256 of the image",
    "OFFSET": "from the answer to routine_erase: bytes that the ECU has already",
    "REST": "LENGTH less OFFSET",
    "COUNTER": "1, 2, ..., 255, 0, 1, ...; the service is repeated until the image has been sent",
    "BLOCK": "next bytes of the image, from OFFSET on; their number is block (answer to download) minus 2",
}


def flash_sequence() -> str:
    """Return the sequence as groups of special data: each step has the name of a service, and then its arguments."""
    steps = "".join(f'<SDG SI="step">{"".join(_step(*line.split()))}</SDG>' for line in SEQUENCE.strip().splitlines())
    known = "".join(_data(name, text) for name, text in ARGUMENTS.items())
    return f'<SDG SI="sequence">{steps}</SDG><SDG SI="values">{known}</SDG>'


def _step(service: str, *arguments: str) -> Iterator[str]:
    yield _data("service", service)
    for argument in arguments:
        yield _data(*argument.split("="))


def _data(name: str, value: str) -> str:
    return f'<SD SI="{name}">{value}</SD>'
