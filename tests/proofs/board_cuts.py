"""The supply of a board cut in every operation of its flash while it is flashed, in machine code from reset on.

Loader, drivers and ECU run on the emulated board; a tester flashes a second release over CAN. What a cut leaves, torn
words included, is taken from one sequence; from there the board is switched on: it must run one of the two releases.
Its recovery is cut once more, and on some boards the second release is flashed to its end. At last a tester reads at
full rate beside control: it must cost no frame of control. All by CAN FD, and again by classic CAN.
"""

import random
import tempfile
import zlib
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, Literal
from unittest.mock import patch

import typer

from can_bridge.tester.sequence import End
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Reason
from contract.config.vehicle import BusConfig
from contract.errors import StillwakeError
from firmware_sim.mcu.board.flash_controller import FlashBank, FlashController, PowerCut
from firmware_sim.mcu.build import Firmware
from tests.can_bridge.flashing.releases import keys
from tests.ecu.in_c.exported import CONFIG, exported
from tests.firmware_sim.mcu.board_node import BoardLine, Built, Traffic
from tests.proofs.command_line import JsonFile, Processes, Seed, in_parts, report

COUNTED: Final = ("cuts", "ran_old", "ran_new", "second_cuts", "second_cuts_taken", "flashed_again", "answers_read")
WRONG: Final = ("without_release", "second_cut_without_release", "not_flashed", "control_frames_lost")
READING_PERIODS: Final = 500
FRAMES: Final[tuple[Literal["fd", "classic"], ...]] = ("fd", "classic")


class Cuts:
    """A board whose supply fails in one operation of its flash."""

    def __init__(self, built: Built, firmware: Firmware | None = None) -> None:
        self._board = built.ecu(firmware=firmware)
        self.firmware, self._image = self._board.firmware, built.image("two", 2)
        self._bus, self._status = built.config.bus, message_set(built.config.bus).status
        self._one, self._two = (int.from_bytes(Built.digest(k)[:2], "big") for k in (1, 2))

    def left(self, built: Built) -> list[bytes]:
        """The flash after a cut in each operation of one sequence over a confirmed release, packed."""
        found: list[bytes] = []
        self._board.power_on(FlashBank(), 0)
        BoardLine(self._board, self._bus).provision(keys(), built.image("one"))
        erase, program = FlashController._erase, FlashController._program

        def cut_and_done(operation: Any, controller: FlashController, *arguments: Any) -> None:
            bank = FlashBank.unpack(controller.bank.pack())
            try:
                operation(FlashController(bank, lambda *_: None, cut_at=1, seed=len(found)), *arguments)
            except PowerCut:
                found.append(zlib.compress(bank.pack(), 1))
            operation(controller, *arguments)

        with (
            patch.object(FlashController, "_erase", lambda *given: cut_and_done(erase, *given)),
            patch.object(FlashController, "_program", lambda *given: cut_and_done(program, *given)),
        ):
            assert BoardLine(self._board, self._bus).flash(self._image).end is End.CONFIRMED
        return found

    def after(self, packed: bytes, seed: int, *, flashes: bool) -> Counter[str]:
        board, found = self._board, Counter(cuts=1)
        board.power_on(FlashBank.unpack(zlib.decompress(packed)), 0)
        release = self._running()
        found[{self._one: "ran_old", self._two: "ran_new"}.get(release, WRONG[0])] += 1
        if operations := board.board.flash.operations:
            found["second_cuts"] += 1
            bank = FlashBank.unpack(zlib.decompress(packed))
            try:
                board.power_on(bank, 0, cut_at=random.Random(seed).randint(1, operations))
                self._running()
            except PowerCut:
                found["second_cuts_taken"] += 1
            board.power_on(bank, 0)
            found[WRONG[1]] += self._running() not in (self._one, self._two)
        if flashes:
            found["flashed_again"] += 1
            ended = BoardLine(board, self._bus).flash(self._image).end in (End.CONFIRMED, End.ALREADY)
            found[WRONG[2]] += not (ended and self._running() == self._two)
        return found

    def _running(self) -> int:
        """The upper half of its release's hash, which each set of frames has; 0 for none."""
        board = self._board
        sent = board.advance(board.board.counter.now_ns + 2 * CONFIG.period_ns)
        status = self._status.parse(next(one.data for one in sent if one.frame_id == self._status.spec.frame_id))
        return 0 if status is None or status.reason is Reason.NO_RELEASE else status.bundle_hash >> 16


def read(built: Built) -> Counter[str]:
    """Ten seconds of reading on a board with a release, counted."""
    board = built.ecu()
    BoardLine(board, built.config.bus).provision(keys(), built.image("one"))
    traffic = Traffic(built.ecu(board.board.flash.bank, board.firmware), built.config)
    answers = traffic.read(READING_PERIODS)
    lost = sum(READING_PERIODS - len(times) for times in traffic.control_frames())
    return Counter(answers_read=answers.total(), control_frames_lost=lost)


def _part(built: Built, firmware: Firmware, folder: Path, every: int, numbers: range) -> Counter[str]:
    cuts, found = Cuts(built, firmware), Counter[str]()
    for number in numbers:
        found += cuts.after((folder / str(number)).read_bytes(), number, flashes=number % every == 0)
    return found


def main(
    json_file: JsonFile = None,
    seed: Seed = 0,
    processes: Processes = 2,
    every: Annotated[int, typer.Option(help="One board in so many is flashed to its end.", min=1)] = 16,
) -> None:
    """Cut the emulated board's power while it is flashed; a board without a release is an error."""
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        release = exported(folder / "release")
        for frames in FRAMES:
            built = Built(release, replace(CONFIG, bus=BusConfig(frames=frames)))
            cuts = Cuts(built)
            left = cuts.left(built)
            for number, packed in enumerate(left):
                (folder / str(number)).write_bytes(packed)
            work = partial(_part, built, cuts.firmware, folder, every)
            for part in in_parts(work, len(left), 20, processes, f"board, {frames}"):
                found += part
            found += read(built)
    figures = {f"board_{name}": found[name] for name in (*COUNTED, *WRONG)}
    report(json_file, "cuts on the board", figures, packages=("stillwake", "unicorn"), seed=seed, every=every)
    if any(found[name] for name in WRONG):
        raise StillwakeError(f"cuts on the board: {dict(found)}")
