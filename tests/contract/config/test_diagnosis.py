"""Identifiers of diagnosis: their notation, and those that are refused, against the DBC as cantools reads it."""

from pathlib import Path
from typing import Any, Final

import pytest
from cantools.database import Database

import contract
from contract.config.diagnosis import CanId, DiagnosisConfig, parse_id
from contract.config.listing import as_toml, sections
from contract.config.loading import from_tree, load_config
from contract.errors import ConfigError

FIXED = {"request_id": "0x18DA5AF1", "response_id": "0x18DAF15A", "functional_id": "0x18DB33F1"}
IDS: Final[Any] = DiagnosisConfig  # a test gives values of any type


def test_digits_tell_the_lengths_apart_on_the_command_line_and_in_a_file(tmp_path):
    notations: dict[int | str, CanId] = {
        "0x7E1": CanId(0x7E1),
        "0X6a1": CanId(0x6A1),
        "0x1": CanId(1),
        "0x18da5af1": CanId(0x18DA5AF1, True),
        "0x00000120": CanId(0x120, True),
        "0x0CDA5AF1": CanId(0xCDA5AF1, True),
        0xCDA5AF1: CanId(0xCDA5AF1, True),
        0x07E0: CanId(0x7E0),
        "0x1FFFFFFF": CanId(0x1FFFFFFF, True),
    }
    for text, expected in notations.items():
        assert parse_id(text) == expected
        assert parse_id(str(expected)) == expected
    path = tmp_path / "own.toml"
    path.write_text(
        '[bus.diagnosis]\nrequest_id = 0x18DA5AF1\nresponse_id = "0x18daf15a"\nfunctional_id = 0x18DB33F1\n'
        "xcp_command_id = 0x6A0\nxcp_response_id = 1\n"
    )
    given = {**FIXED, "xcp_command_id": "0x6a0", "xcp_response_id": '"0x001"'}
    found = load_config(None, [f"bus.diagnosis.{name}={value}" for name, value in given.items()]).bus.diagnosis
    assert load_config(path).bus.diagnosis == found
    assert found.heard == {CanId(0x18DA5AF1, True), CanId(0x18DB33F1, True), CanId(0x6A0)}
    assert (found.response, found.xcp_response) == (CanId(0x18DAF15A, True), CanId(1))
    path.write_text(as_toml(sections(load_config(path))))
    assert load_config(path).bus.diagnosis == found
    usual = DiagnosisConfig()
    assert (usual.request, usual.response, usual.functional) == (CanId(0x7E0), CanId(0x7E8), None)


def test_what_is_no_identifier_is_refused_in_one_line():
    notation = r"must be (empty, )?0x and 3 hex digits \(11 bits, up to 0x7FF\), or 0x and 8 \(29 bits"
    texts = ["7E1", "2017", "0x", "0x800", "0xFFF", "0x07E0", "0x18DA5AF", "0x20000000", "0x018DA5AF1", "-0x1", "0x7G0"]
    values: list[int | str] = [*texts, " 0x7E1", "0x7E1 ", 0x800, 0x20000000, -1, 10**30]
    for value in values:
        for name in ("request_id", "functional_id", "xcp_response_id"):
            with pytest.raises(ConfigError, match=rf"^bus\.diagnosis\.{name} = [^\n]+: {notation}[^\n]*$"):
                IDS(**{name: value})
    for name in ("request_id", "response_id"):
        with pytest.raises(ConfigError, match=notation):
            IDS(**{name: ""})
    for tree in ({"request_id": 2.5}, {"request_id": True}, {"request_id": ["0x7E1"]}):
        with pytest.raises(ConfigError, match=r"^bus\.diagnosis\.request_id = .*: must be a whole number or text$"):
            from_tree({"bus": {"diagnosis": tree}})


def test_one_that_is_taken_is_refused():
    dbc = Database()
    dbc.add_dbc_string(Path(contract.__file__).with_name("stillwake.dbc").read_text(encoding="utf-8"))
    assert len(dbc.messages) == 12
    for message in dbc.messages:
        for name in ("request_id", "functional_id", "xcp_command_id"):
            wanted = rf"\.{name} = '0x{message.frame_id:03X}': must be an identifier other than that of {message.name} "
            with pytest.raises(ConfigError, match=wanted):
                IDS(**{name: message.frame_id})
        # The same number with 29 bits is another identifier.
        DiagnosisConfig(request_id=f"0x{message.frame_id:08X}", response_id="0x18DAF15A")
    taken, length = r"must be an identifier other than that of bus\.diagnosis\.\w+$", "must be (11|29) bits long, like"
    for given, wanted in (
        ({"request_id": "0x7E8"}, taken),
        ({"response_id": "0x7D0"}, taken),
        ({"functional_id": "0x7E0"}, taken),
        ({"xcp_command_id": "0x7D8"}, taken),
        ({**FIXED, "functional_id": "0x18DA5AF1"}, taken),
        ({"request_id": "0x18DA5AF1"}, rf"\.response_id = .*: {length}"),
        ({"functional_id": "0x18DB33F1"}, rf"\.functional_id = .*: {length}"),
        ({**FIXED, "functional_id": "0x7DF"}, rf"\.functional_id = .*: {length}"),
        ({"xcp_command_id": "0x00000700"}, rf"\.xcp_response_id = .*: {length}"),
    ):
        with pytest.raises(ConfigError, match=wanted):
            IDS(**given)
