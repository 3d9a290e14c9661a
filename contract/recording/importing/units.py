"""Units of numbers in a file, and what 1 of ours is in them."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from contract.errors import ConfigError, DatasetError

_KNOWN: Final[Mapping[str, tuple[str, float]]] = {
    name: (base, size)
    for base, size, names in (
        ("1", 1.0, "|1|-|none|dimensionless|W/U_inf|t_c|U_inf|U_inf W|rho U_inf^3 W / 2"),
        ("1", 0.01, "%|percent"),
        ("s", 1.0, "s|sec|second|seconds"),
        ("s", 1e-3, "ms|msec|millisecond|milliseconds"),
        ("s", 1e-6, "us|µs|μs|microseconds"),  # micro sign and Greek mu
        ("s", 60.0, "min|minutes"),
        ("s", 3600.0, "h|hours"),
        ("Pa", 1.0, "Pa|pascal|N/m2|N m-2"),
        ("Pa", 100.0, "hPa|mbar|millibar"),
        ("Pa", 1e3, "kPa"),
        ("Pa", 1e5, "bar"),
        ("Pa", 6894.757293168, "psi"),
        ("m2/s2", 1.0, "m2/s2|m2 s-2"),
        ("N", 1.0, "N"),
        ("N", 1e3, "kN"),
        ("N", 1e-3, "mN"),
        ("N/m", 1.0, "N/m|N m-1"),
        ("m3/s", 1.0, "m3/s|m3 s-1"),
        ("m3/s", 1e-3, "l/s|L/s"),
        ("m2/s", 1.0, "m2/s|m2 s-1"),
    )
    for name in names.split("|")
}
"""Base unit and size in it; "1" is what has no dimension."""
_REMEDIES: Final = {
    "Pa": "give rho U_inf^2 / 2 as in --reference Cp=240Pa",
    "s": "give W / U_inf as in --reference t=5ms",
    "N": "give rho U_inf^2 / 2 times W and the span as in --reference {name}=40N",
}
_BEHIND: Final = re.compile(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
_REFERENCE: Final = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What 1 of ours is in the files: a force of 40 N for a coefficient of 1. Without a unit, in that of the file."""

    number: float
    unit: str | None
    option: str

    def __str__(self) -> str:
        return f"{self.number:g}{self.unit or ''}"


def references_of(texts: Sequence[str]) -> dict[str, Reference]:
    """By the name, those of --reference NAME=NUMBER[UNIT]; raises ConfigError for anything else."""
    found: dict[str, Reference] = {}
    for text in texts:
        option = f"--reference {text}"
        name, _, value = (part.strip() for part in text.partition("="))
        parts = _REFERENCE.fullmatch(value)
        if not name or parts is None or not 0.0 < abs(float(parts[1])) < float("inf"):
            raise ConfigError(f"{option}: write NAME=NUMBER and its unit, such as Cd=40N or t=5ms; not 0")
        if name in found:
            raise ConfigError(f"{option}: {name} has one already, {found[name]}")
        found[name] = Reference(number=float(parts[1]), unit=parts[2] or None, option=option)
    return found


def split_unit(column: str) -> tuple[str, str | None]:
    """A column's name without the known unit in brackets behind it, and that."""
    parts = _BEHIND.fullmatch(column)
    if parts is None or parts[3] == "1":  # a number, as in "tap (1)"
        return column, None
    unit = parts[2] or parts[3] or ""
    return (parts[1], unit) if _plain(unit) in _KNOWN else (column, None)


def factor(path: Path, name: str, inside: str, unit: str | None, reference: Reference | None) -> float:
    """What the numbers of `name`, called `inside` in the file and in `unit` by its own word, are to be multiplied by.
    Raises DatasetError if they have a dimension and no reference, or one of another dimension."""
    base, size = ("1", 1.0) if unit is None else _base(unit)
    if reference is None:
        if base != "1":
            remedy = _REMEDIES.get(base, "give what 1 of ours is in it as in --reference {name}=NUMBER").format(
                name=name
            )
            raise DatasetError(f"{path}: {inside!r} is in {unit!r}, {name} must be without dimension: {remedy}")
        return size
    if unit is None or reference.unit is None:
        return 1.0 / reference.number
    other, other_size = _base(reference.unit)
    if base != other:
        raise DatasetError(f"{path}: {inside!r} is in {unit!r} by the file's own word, which {reference.option} is not")
    return size / (reference.number * other_size)


def seconds_in(unit: str | None) -> float | None:
    """Seconds of a unit of time; None for any other."""
    base, size = ("1", 1.0) if unit is None else _base(unit)
    return size if base == "s" else None


def _base(unit: str) -> tuple[str, float]:
    return _KNOWN.get(_plain(unit), (unit, 1.0))


def _plain(unit: str) -> str:
    """Without the date of CF's times, and m^3 as m3."""
    unit = unit.split(" since ")[0].strip()
    return unit if unit in _KNOWN else unit.replace("^", "").replace("**", "")
