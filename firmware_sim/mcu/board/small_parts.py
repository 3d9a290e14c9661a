"""The board's counter, timer of time stamps, random number generator and core registers, as the firmware uses them.
`read` and `write` of a register, at an offset in bytes, raise McuError if the register is not modelled."""

import random
from collections.abc import Callable
from typing import Final

from contract.errors import McuError

_RESET: Final = 0x05FA_0004
_BFHFNMIGN: Final = 1 << 8
CPACR: Final = 0xD88
"""Offset of the register that enables the floating-point unit."""


class SystemReset(Exception):  # noqa: N818
    """An exception that ends a power cycle, because the firmware requested a reset."""


class Counter:
    """The generic counter of Arm (CNTReadBase: CNTCV) at 1 GHz, followed by a compare register. The core's sleep ends
    when the counter reaches the compare value. Both have two words, the low word first, at offsets 0 and 8."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns, self.compare_ns = now_ns, 0

    def read(self, offset: int) -> int:
        if offset not in (0, 4, 8, 12):
            raise McuError(f"counter: no register at {offset:#x}")
        value = self.now_ns if offset < 8 else self.compare_ns
        return value >> 8 * (offset & 4) & 0xFFFF_FFFF

    def write(self, offset: int, value: int) -> None:
        if offset not in (8, 12):
            raise McuError(f"counter: no register to write at {offset:#x}")
        shift = 8 * (offset & 4)
        self.compare_ns = self.compare_ns & ~(0xFFFF_FFFF << shift) | value << shift


class StampTimer:
    """The timer TIM3 of an STM32H743 at 240 MHz, which counts time stamps: CR1 (CEN), EGR (UG), CNT and PSC. A new
    prescaler acts after the next update event."""

    _CLOCK_MHZ: Final = 240

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self._now_ns = now_ns
        self._prescaler = self._next = 0
        self._began_ns: int | None = None

    def count(self, at_ns: int) -> int:
        """Return the count at a time in ns; 0 before the timer was started."""
        if self._began_ns is None:
            return 0
        return (at_ns - self._began_ns) * self._CLOCK_MHZ // (1000 * (self._prescaler + 1)) & 0xFFFF

    def read(self, offset: int) -> int:
        if offset != 0x24:
            raise McuError(f"TIM3: no register to read at {offset:#x}")
        return self.count(self._now_ns())

    def write(self, offset: int, value: int) -> None:
        if offset == 0x28:
            self._next = value
        elif offset == 0x14 and value == 1:
            self._prescaler = self._next
        elif offset == 0 and value == 1:
            self._began_ns = self._now_ns()
        else:
            raise McuError(f"TIM3: no register to write at {offset:#x}")


class RandomNumbers:
    """The RNG of an STM32H743 (CR with RNGEN, SR with DRDY and SEIS, DR); a seed determines its random numbers. With
    `has_seed_error`, SR reports an error of the seed; DR may then still have a value that must not be used."""

    def __init__(self, seed: int) -> None:
        self._random, self._control, self.has_seed_error = random.Random(seed), 0, False

    def read(self, offset: int) -> int:
        enabled = bool(self._control & 4)
        if offset == 8:
            return self._random.getrandbits(32) if enabled else 0
        return {0: self._control, 4: int(enabled) | self.has_seed_error << 6}[offset]

    def write(self, offset: int, value: int) -> None:
        self._control = value if offset == 0 else self._control


class CoreRegisters:
    """The system control space: CPACR, CCR with BFHFNMIGN, AIRCR with SYSRESETREQ, and the NVIC's ISER0 and ICPR0."""

    _KEPT: Final = (0x100, 0x280, 0xD14, CPACR)

    def __init__(self) -> None:
        self._kept = dict.fromkeys(self._KEPT, 0)

    @property
    def has_floats(self) -> bool:
        """Whether CPACR enables the floating-point unit."""
        return self._kept[CPACR] >> 20 & 0xF == 0xF

    @property
    def ignores_bus_faults(self) -> bool:
        """Whether CCR lets handlers of the highest priority continue after a bus fault."""
        return bool(self._kept[0xD14] & _BFHFNMIGN)

    def read(self, offset: int) -> int:
        if offset not in self._kept:
            raise McuError(f"core: no register to read at {0xE000_E000 + offset:#x}")
        return self._kept[offset]

    def write(self, offset: int, value: int) -> None:
        """Write a register. Raises SystemReset if the firmware requests a reset."""
        if offset == 0xD0C:
            if value == _RESET:
                raise SystemReset
        elif offset in self._kept:
            self._kept[offset] = value
        else:
            raise McuError(f"core: no register to write at {0xE000_E000 + offset:#x}")
