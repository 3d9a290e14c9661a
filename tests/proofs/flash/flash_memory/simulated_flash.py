"""A flash memory in virtual time with the manners of a real one: torn words, wear, bad sectors, power cuts at will.

Every programmed word and every erased sector is one operation; `cut_at` names the one in whose middle the supply is
lost. What a cut leaves behind follows from the seed and the operation's number, so that each case can be played again:

- a torn word looks erased and is weak (programming it makes it unreadable), or has some of its bits, or all, or is
  unreadable;
- a torn erasure leaves each word of the sector old, erased and weak, of random bits, or unreadable.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from random import Random
from typing import Final, Self

from can_bridge.flashing.medium import MediumError
from tests.can_bridge.flashing.medium import ERASED, WORD, PowerCut, UnreadableError, WornOutError

SECTORS: Final = 16
SECTOR_SIZE: Final = 128 * 1024
"""Bytes of a sector of an STM32H743 (RM0433, table 12)."""
_SPREAD: Final = 0.1
"""Sectors wear out within this share of the endurance."""


class _Word(IntEnum):
    """What programming or reading a word would do."""

    CLEAN = 0
    WEAK = 1
    PROGRAMMED = 2
    BROKEN = 3


@dataclass(eq=False)
class _Sector:
    content: bytearray
    words: bytearray
    erasures: int = 0
    left: int | None = None
    """Words that can still be programmed before it turns out bad; None in a sound sector."""

    def copy(self) -> "_Sector":
        return _Sector(bytearray(self.content), bytearray(self.words), self.erasures, self.left)


class SimulatedFlash:
    """A `Medium`; its state is the chip's, nothing of it is lost with the supply.

    Attributes:
        operations: words programmed and sectors erased so far, a torn one included.
        cut_at: number of the operation that a loss of supply tears, counted from 0; None for none.
    """

    def __init__(
        self,
        sectors: int = SECTORS,
        sector_size: int = SECTOR_SIZE,
        *,
        seed: int = 0,
        endurance: int | None = None,
        bad: Mapping[int, int] | None = None,
    ) -> None:
        """An erased one.

        Args:
            sectors: how many.
            sector_size: bytes of each, a multiple of `WORD`.
            seed: of what tears leave behind, and of when sectors wear out.
            endurance: erasures after which a sector fails, give or take a tenth; None for no end.
            bad: by sector, the words that can be programmed before it fails; 0: it cannot even be erased.

        Raises:
            ValueError: no sectors, or of a size that is no multiple of `WORD`.
        """
        if sectors < 1 or sector_size < WORD or sector_size % WORD:
            raise ValueError(f"{sectors} sectors of {sector_size} bytes: must be 1 or more, of a multiple of {WORD}")
        self.operations = 0
        self.cut_at: int | None = None
        self._seed = seed
        self._size = sector_size
        self._powered = True
        self._limits = [
            None
            if endurance is None
            else round(endurance * Random(f"{seed} wear {n}").uniform(1 - _SPREAD, 1 + _SPREAD))
            for n in range(sectors)
        ]
        words = sector_size // WORD
        self._sectors = [
            _Sector(bytearray(ERASED * words), bytearray(words), 0, (bad or {}).get(n)) for n in range(sectors)
        ]
        self._own = set(range(sectors))

    @property
    def sectors(self) -> int:
        return len(self._sectors)

    @property
    def sector_size(self) -> int:
        return self._size

    @property
    def erasures(self) -> tuple[int, ...]:
        """How often each sector was erased so far."""
        return tuple(sector.erasures for sector in self._sectors)

    def power_on(self, cut_at: int | None = None) -> None:
        """Supply is back; the next cut, if any, tears that operation."""
        self._powered = True
        self.cut_at = cut_at

    def copy(self, seed: int | None = None) -> Self:
        """Another chip in the same state; sectors are copied when one of the two changes them."""
        made = object.__new__(type(self))
        made.__dict__.update(self.__dict__)
        made._seed = self._seed if seed is None else seed
        made._sectors = list(self._sectors)
        self._own, made._own = set(), set()
        return made

    def read(self, address: int, length: int) -> bytes:
        """Raises UnreadableError if a word in it is torn."""
        if not self._powered:
            raise PowerCut
        if length < 0 or address < 0 or address + length > self.sectors * self._size:
            raise MediumError(f"flash: {length} bytes at {address:#x}: must lie within {self.sectors} sectors", address)
        parts = []
        end = address + length
        while address < end:
            number, at = divmod(address, self._size)
            piece = min(end - address, self._size - at)
            sector = self._sectors[number]
            broken = sector.words.find(_Word.BROKEN, at // WORD, -(-(at + piece) // WORD))
            if broken >= 0:
                place = number * self._size + broken * WORD
                raise UnreadableError(f"flash: the word at {place:#x} is torn: erase its sector", place)
            parts.append(bytes(sector.content[at : at + piece]))
            address += piece
        return b"".join(parts)

    def program(self, address: int, data: bytes) -> None:
        """Program erased words one after the other.

        Raises:
            PowerCut: in the middle of one of them.
            WornOutError: the sector is bad.
            MediumError: no whole words, or one that was programmed before.
        """
        if address % WORD or len(data) % WORD or not 0 <= address <= self.sectors * self._size - len(data):
            raise MediumError(f"flash: {len(data)} bytes to {address:#x}: must be whole words within it", address)
        for at in range(0, len(data), WORD):
            self._program_word(address + at, data[at : at + WORD])

    def erase(self, sector: int) -> None:
        """All its words to ones; raises WornOutError if the sector is bad, PowerCut in the middle of it."""
        if not 0 <= sector < self.sectors:
            raise MediumError(f"flash: sector {sector}: must be in 0..{self.sectors - 1}", sector * self._size)
        cut = self._operate()
        found = self._changed(sector)
        found.erasures += 1
        limit = self._limits[sector]
        if cut:
            self._tear_erasure(found)
            raise PowerCut
        if found.left == 0 or (limit is not None and found.erasures > limit):
            raise WornOutError(f"flash: sector {sector} can no longer be erased: use another", sector * self._size)
        words = self._size // WORD
        found.content[:], found.words[:] = ERASED * words, bytes(words)

    def _program_word(self, address: int, data: bytes) -> None:
        cut = self._operate()
        number, at = divmod(address, self._size)
        sector, word = self._changed(number), at // WORD
        if sector.words[word] in (_Word.PROGRAMMED, _Word.BROKEN):
            raise MediumError(f"flash: the word at {address:#x} was programmed before: erase its sector", address)
        if sector.left == 0:
            raise WornOutError(f"flash: sector {number} can no longer be programmed: use another", address)
        if sector.left is not None:
            sector.left -= 1
        if sector.words[word] == _Word.WEAK:
            sector.words[word] = _Word.BROKEN
        else:
            sector.content[at : at + WORD], sector.words[word] = data, _Word.PROGRAMMED
            if cut:
                self._tear_word(sector, word, data)
        if cut:
            raise PowerCut

    def _operate(self) -> bool:
        """Count an operation; whether the supply is lost in it."""
        if not self._powered:
            raise PowerCut
        cut = self.operations == self.cut_at
        self.operations += 1
        self._powered = not cut
        return cut

    def _changed(self, number: int) -> _Sector:
        """A sector that no copy shares."""
        if number not in self._own:
            self._sectors[number] = self._sectors[number].copy()
            self._own.add(number)
        return self._sectors[number]

    def _tear_word(self, sector: _Sector, word: int, data: bytes) -> None:
        rng = Random(f"{self._seed} torn {self.operations}")
        became = rng.choice((_Word.WEAK, _Word.PROGRAMMED, _Word.PROGRAMMED, _Word.BROKEN))
        # Programming turns ones into zeros: a part of its bits is the data with some ones left.
        kept = rng.choice((bytes(WORD), rng.randbytes(WORD)))
        bits = ERASED if became == _Word.WEAK else bytes(a | b for a, b in zip(data, kept, strict=True))
        sector.content[word * WORD : (word + 1) * WORD], sector.words[word] = bits, became

    def _tear_erasure(self, sector: _Sector) -> None:
        rng = Random(f"{self._seed} torn {self.operations}")
        # Some cuts come early, some late: then nearly all words are old, or erased.
        weights = rng.choice(((1, 1, 1, 1), (50, 1, 1, 1), (1, 50, 1, 1)))
        for word, became in enumerate(rng.choices(("old", "weak", "random", "broken"), weights, k=len(sector.words))):
            span = slice(word * WORD, (word + 1) * WORD)
            if became == "weak":
                sector.content[span], sector.words[word] = ERASED, _Word.WEAK
            elif became == "random":
                sector.content[span], sector.words[word] = rng.randbytes(WORD), _Word.PROGRAMMED
            elif became == "broken":
                sector.words[word] = _Word.BROKEN
            elif sector.words[word] == _Word.CLEAN:
                sector.words[word] = _Word.WEAK
