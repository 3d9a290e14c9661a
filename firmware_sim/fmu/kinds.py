"""The kinds of FMU, and the names of the kinds that a user writes before the name of an FMU's file."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

from contract.errors import OutputError

FMU_SUFFIX: Final = ".fmu"


@dataclass(frozen=True, kw_only=True)
class FmuKind:
    """A kind of FMU. bus: a CAN bus terminal (FMI-LS-BUS 1.0) replaces the input signals. triggered: the terminal's
    Tx_Clock is a triggered clock instead of a countdown clock, for importers with fixed steps. fmi2: FMI 2.0 instead of
    3.0. windows: the FMU also has a library for Windows on x86-64."""

    bus: bool = False
    triggered: bool = False
    fmi2: bool = False
    windows: bool = False

    @property
    def sources(self) -> tuple[str, ...]:
        """The folders in `ecu/c/fmu` whose sources the FMU needs in addition to the ECU's sources."""
        return ("bus" if self.bus else "signals", *(["fmi2"] if self.fmi2 else []))

    @property
    def words(self) -> str:
        return f"FMI {'2.0' if self.fmi2 else '3.0'} co-simulation{', CAN bus by FMI-LS-BUS 1.0' if self.bus else ''}"


WITH_SIGNALS: Final = FmuKind()
FMU_KINDS: Final = tuple(field.name for field in fields(FmuKind))


def kind_and_path(text: str, names: tuple[str, ...] = FMU_KINDS) -> tuple[FmuKind, Path]:
    """Return the kind and the path in `KIND,KIND:FILE` or `FILE`. Raises OutputError for a kind that is not in `names`,
    for kinds that exclude each other, and for a wrong ending of the file name."""
    before, colon, after = text.rpartition(":")
    chosen = [name.strip() for name in before.split(",")] if colon and len(before) > 1 else []
    path = Path(after if chosen else text)
    for name in chosen:
        if name not in names:
            raise OutputError(f"{text}: {name}: must be one of {', '.join(names)}")
    kind = FmuKind(**dict.fromkeys(chosen, True))
    if kind.bus and kind.fmi2:
        raise OutputError(f"{text}: bus and fmi2: FMI 2.0 has no bus; give only one of them")
    if kind.triggered and not kind.bus:
        raise OutputError(f"{text}: triggered needs a bus: give bus,triggered")
    if path.suffix.lower() != FMU_SUFFIX:
        raise OutputError(f"{path}: must be a file ending in {FMU_SUFFIX}")
    return kind, path
