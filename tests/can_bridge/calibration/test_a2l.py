"""The file as a tool reads it: by a small strict reader, and by a2ltool where it is installed."""

import re
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from can_bridge.calibration.a2l import a2l_text
from can_bridge.calibration.daq import EVENT_NAME, MEASURED_ADDRESS, MEASURED_BYTES, measured_bytes
from can_bridge.calibration.segment import ADDRESS, Page
from can_bridge.calibration.xcp import Command
from can_bridge.wire.messages import Mode, Reason
from contract.config.diagnosis import DiagnosisConfig
from contract.config.vehicle import BusConfig
from contract.controller.calibration import CALIBRATION_NAMES
from tests.can_bridge.calibration.conftest import LIMITS, REFERENCE, changed

TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|/begin|/end|[^\s"]+')
A2LTOOL = shutil.which("a2ltool") or shutil.which("a2ltool", path=str(Path(sys.executable).parent))
DATA_TYPES = {"FLOAT32_IEEE": "<f", "ULONG": "<I", "UBYTE": "<B", "SBYTE": "<b"}
PERIOD_NS = 20_000_000
VALUES = changed(**{name: 0.5 + index for index, name in enumerate(CALIBRATION_NAMES[:7])}, delay_steps=5)


class Block(NamedTuple):
    """The words between /begin and /end, and the blocks within."""

    keyword: str
    words: list[str]
    blocks: list["Block"]

    def all(self, keyword: str) -> list["Block"]:
        return [block for block in self.blocks if block.keyword == keyword]

    def one(self, keyword: str) -> "Block":
        (block,) = self.all(keyword)
        return block

    def after(self, word: str) -> str:
        return self.words[self.words.index(word) + 1]


def read(text: str) -> Block:
    root = Block("", [], [])
    open_blocks = [root]
    # The meta language has its own grammar; whether the rest follows it is for the tools below.
    tokens = iter(TOKEN.findall(re.sub(r"(?s)/begin A2ML.*?/end A2ML", "", text)))
    for token in tokens:
        if token == "/begin":
            block = Block(next(tokens), [], [])
            open_blocks[-1].blocks.append(block)
            open_blocks.append(block)
        elif token == "/end":
            assert next(tokens) == open_blocks.pop().keyword
        else:
            open_blocks[-1].words.append(token)
    assert open_blocks == [root]
    return root


@pytest.fixture
def text(segment) -> str:
    return a2l_text(segment, release='truck "wake"\\4.1\näöü', bus=BusConfig(), period_ns=PERIOD_NS)


@pytest.fixture
def module(text) -> Block:
    return read(text).one("PROJECT").one("MODULE")


def test_it_is_plain_text_of_version_1_71(text, module):
    assert text.isascii()
    assert read(text).words == ["ASAP2_VERSION", "1", "71"]
    assert max(map(len, text.splitlines())) <= 132
    assert module.one("MOD_PAR").after("VERSION") == r'"truck \"wake\"\\4.1????"'
    assert module.one("MOD_COMMON").after("BYTE_ORDER") == "MSB_LAST"


def test_every_value_is_where_the_file_says_with_its_limits_and_unit(module):
    layouts = {block.words[0]: block.words[3] for block in module.all("RECORD_LAYOUT")}
    units = {block.words[0]: block.words[-1] for block in module.all("COMPU_METHOD")}
    blocks = module.all("CHARACTERISTIC")
    assert [block.words[0] for block in blocks] == list(CALIBRATION_NAMES)
    rows = zip(blocks, VALUES.values, LIMITS.least.values, LIMITS.greatest.values, strict=True)
    for block, value, least, greatest in rows:
        name, _, kind, address, layout, difference, conversion, *limits = block.words
        assert (kind, difference) == ("VALUE", "0")
        there = struct.unpack_from(DATA_TYPES[layouts[layout]], VALUES.pack(), int(address, 16) - ADDRESS)
        assert there == pytest.approx((value,)), name
        assert [float(word) for word in limits] == [least, greatest]
        expected = {"action_limit": '"U_inf W"', "command_step": '"U_inf W"', "delay_steps": '"control periods"'}
        assert units[conversion] == expected.get(name, '""')
    groups = [name for block in module.all("GROUP")[:-1] for name in block.one("REF_CHARACTERISTIC").words]
    assert groups == list(CALIBRATION_NAMES)


def test_what_is_measured_is_where_the_file_says(module, slave):
    pressures = np.array([0.25, -0.5, 0.75, -1.0])
    states: dict[str, Any] = {"mode": Mode.CONTROL, "reason": Reason.STALE, "gated": 48, "calibration": VALUES}
    measured = measured_bytes(pressures, 0.0625, **states, correction=0.9476)
    expected = [*pressures, 0.0625, Mode.CONTROL, Reason.STALE, 48, -52, *VALUES.values]
    blocks = module.all("MEASUREMENT")
    assert module.all("GROUP")[-1].one("REF_MEASUREMENT").words == [block.words[0] for block in blocks]
    end = MEASURED_ADDRESS
    for block, value in zip(blocks, expected, strict=True):
        form, address = DATA_TYPES[block.words[2]], int(block.after("ECU_ADDRESS"), 16)
        assert address == end
        end += struct.calcsize(form)
        assert struct.unpack_from(form, measured, address - MEASURED_ADDRESS) == pytest.approx((value,))
    assert end == MEASURED_ADDRESS + MEASURED_BYTES
    words = {block.words[0]: block.words for block in module.all("COMPU_VTAB")}
    for name, numbers in (("mode_words", Mode), ("reason_words", Reason)):
        assert words[name][4:] == [word for item in numbers for word in (str(item.value), f'"{item.name}"')]
    daq = module.one("IF_DATA").one("DAQ")
    (event,) = daq.all("EVENT")
    ask = lambda command: slave.command(0, bytes.fromhex(command))[0]  # noqa: E731
    ask("FF00")
    processor, resolution, found = ask("DA"), ask("D9"), ask("D7000000")
    assert (daq.words[0], daq.words[2]) == ("DYNAMIC", str(processor[4])) and processor[1] & 1
    assert daq.words[8] == str(resolution[2])
    assert event.words[2:8] == ["0", "DAQ", *(str(found[i]) for i in (2, 4, 5, 6))]
    assert found[4] * 10 ** found[5] == PERIOD_NS
    assert event.words[0] == f'"{EVENT_NAME.decode()}"' and len(EVENT_NAME) == found[3]


def test_the_segment_and_how_a_tool_reaches_it(module, slave, segment):
    memory = module.one("MOD_PAR").one("MEMORY_SEGMENT")
    assert memory.words[2:] == ["DATA", "RAM", "INTERN", "0x20000000", "0x2c", *["-1"] * 5]
    assert len(REFERENCE.pack()) == 0x2C
    described = memory.one("IF_DATA").one("SEGMENT")
    assert described.words == ["0", "2", "0", "0", "0"]
    access = {Page.WORKING: "XCP_WRITE_ACCESS_DONT_CARE", Page.REFERENCE: "XCP_WRITE_ACCESS_NOT_ALLOWED"}
    assert {int(page.words[0]): page.words[3] for page in described.all("PAGE")} == access
    interface = module.one("IF_DATA")
    can = interface.one("XCP_ON_CAN")
    assert (can.after("CAN_ID_MASTER"), can.after("CAN_ID_SLAVE")) == ("0x7d0", "0x7d8")
    assert can.after("BAUDRATE") == "500000"
    assert can.one("CAN_FD").after("CAN_FD_DATA_TRANSFER_BAUDRATE") == "2000000"
    protocol = interface.one("PROTOCOL_LAYER").words
    (connected,) = slave.command(0, b"\xff\x00")
    assert [int(word) for word in protocol[8:10]] == [connected[3], int.from_bytes(connected[4:6], "little")]
    assert "BYTE_ORDER_MSB_LAST" in protocol
    listed = [Command[protocol[i + 1]] for i, word in enumerate(protocol) if word == "OPTIONAL_CMD"]
    mandatory = "CONNECT DISCONNECT GET_STATUS SYNCH DOWNLOAD SET_CAL_PAGE GET_CAL_PAGE"
    assert {command.name for command in set(Command).difference(listed)} == set(mandatory.split())
    for command in listed:
        assert slave.command(0, bytes([command]) + bytes(7)) != [b"\xfe\x20"]
    extended = DiagnosisConfig(xcp_command_id="0x18EF5AF1", xcp_response_id="0x00000120")
    classic = a2l_text(segment, release="r", bus=BusConfig(frames="classic", diagnosis=extended), period_ns=PERIOD_NS)
    can = read(classic).one("PROJECT").one("MODULE").one("IF_DATA").one("XCP_ON_CAN")
    assert can.blocks == []
    # Bit 31 marks 29 bits (part 3, table of XCP_ON_CAN).
    assert (can.after("CAN_ID_MASTER"), can.after("CAN_ID_SLAVE")) == ("0x98ef5af1", "0x80000120")


@pytest.mark.processes
@pytest.mark.skipif(A2LTOOL is None, reason="a2ltool is not installed")
def test_a2ltool_finds_nothing_to_complain_of(text, tmp_path):
    path = tmp_path / "stillwake.a2l"
    path.write_text(text, encoding="ascii")
    command = [str(A2LTOOL), "--strict", "--check", "--show-xcp", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    for words in ("No problems found", "CAN id master: 0x7D0", "CAN id slave: 0x7D8"):
        assert words in done.stdout
