"""The words of version 1.0.0 with new names. A call with an old word ends with a line that states the new word."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from contract.errors import StillwakeError

_TRUST: Final = "stillwake bundle inspect --trust"
_RUN: Final = {"--start": "--state", "--trust": _TRUST}
OLD: Final[Mapping[str, Mapping[str, str]]] = {
    "": {"--config": "--set FILE.toml"},
    "run": _RUN
    | {"--fault": "--disturb", "--fault-seed": "--seed", "--clock-mhz": "--ecu mcu@NUMBER"}
    | {"--ecu cortex-m7": "--ecu mcu", "--ecu cortex-m7-board": "--ecu mcu", "--plant stillwake": "--plant wake"},
    "report": {"--picture": "--output", "--csv": "--output"},
    "campaign": {"--trust": _TRUST, "--scheduler": "--workers ADDRESS", "--quick": "--phases 1 --controlled 40"},
    "vehicle": _RUN
    | {"--live": "--plant wake", "--enable-after": "--lead-in", "--slow-down": "--set operating_point.speed=NUMBER"},
    "bench serve": {"": "stillwake live"},
    "live": _RUN | {"--controller": "--ecu", "--enable-after": "--lead-in"},
    "bench latency": {"": "stillwake latency"},
    "latency": {"--trust": _TRUST},
    "ecu": {"--processor": "taskset --cpu-list NUMBER stillwake ecu"},
    "ecu board": {"": "stillwake ecu --mcu FILE"},
    "ecu info": {"": "stillwake diagnose"},
    "diagnose faults": {"": "stillwake diagnose"},
    "diagnose pdx": {"": "stillwake export --for-testers FOLDER"},
    "calibrate": {"--a2l": "stillwake export --for-testers FOLDER"},
    "flash-keys": {"": "stillwake flash --keys"},
    "bundle verify": {"": "stillwake bundle inspect"},
    "bundle sbom": {"": "stillwake bundle inspect --sbom FILE"},
    "bundle keygen": {"": "stillwake keygen"},
    "bundle keylist": {"--show": "stillwake bundle inspect FILE", "--root": "--key"},
    "bundle renew": {"--sensors": "--dataset"},
    "bundle diff": {"--trust": _TRUST},
    "can keygen": {"": "stillwake keygen --secret"},
    "can monitor": {"--log": "stillwake can monitor FILE"},
    "dataset check": {"": "stillwake dataset inspect"},
    "dataset show": {"": "stillwake dataset inspect"},
    "dataset import": {
        **{f"--{role}": f"{role}=FILE" for role in ("train", "test", "extended", "controlled")},
        **{"--sensors": "--layout", "--dynamic-pressure": "--reference Cp=NUMBERPa", "--forces-map": "--map"},
        **{"--period": "--set flow.control_period=NUMBER", "--limit": "--set flow.action_limit=NUMBER"},
        **{"--reynolds": "--set flow.reynolds=NUMBER"},
    },
    "record": {
        **{f"--{kind}": f"{kind}=STEPS" for kind in ("training", "chirp", "uncontrolled", "controlled", "calm")},
        **{"--start": "--state", "--scheduler": "--workers ADDRESS"},
    },
    "refine": {"--start": "--state"},
    "export": {"--sensors": "--estimator"},
    "plant-fmu": {"--start": "--state"},
    "identify": {"": "python examples/linear_feedback.py"},
    "steady": {"": "stillwake develop --steady"},
    "animate": {"": "stillwake picture FILE.gif"},
    "picture vorticity": {"": "stillwake picture"},
    "picture pressure": {"": "stillwake picture --field pressure"},
    "picture mean": {"": "stillwake picture --field mean"},
    "picture": {
        **{f"--{name}": f"--forcing sine:{name}=NUMBER" for name in ("amplitude", "frequency")},
        **{"--seed": "--forcing training:seed=NUMBER", "--run": "--forcing FOLDER", "--skip": "--settle"},
    },
}
"""The new word for each old word, by command. The old word is empty if the command itself has a new name."""


class OldWordError(StillwakeError):
    """The error for a command line with a command, option or option value of an earlier version."""

    status = 2


def rows() -> Iterator[tuple[str, str]]:
    """Yield each old word together with its command, and the new word."""
    for command, words in OLD.items():
        yield from (((f"{command} {old}").strip(), new) for old, new in words.items())


def refuse_old(words: Sequence[str]) -> None:
    """Raise OldWordError if the command line after `stillwake` contains a word of `OLD`."""
    given = [part for word in words for part in (word.split("=", 1) if word.startswith("--") else [word])]
    given = given[: given.index("--")] if "--" in given else given
    for old, new in rows():
        command, dashes, option = old.partition("--")
        begin, wanted = command.split(), f"{dashes}{option}".split()
        ends = range(len(begin), len(given) - len(wanted) + 1)
        if given[: len(begin)] == begin and any(given[at : at + len(wanted)] == wanted for at in ends):
            raise OldWordError(f"`{old}` is `{new}` now")
