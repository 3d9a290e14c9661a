"""Settings, options, logs and C on the pages are what they look like."""

import configparser
import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from contract.config.loading import load_config
from firmware_sim.in_c.compiler import host_compiler
from tests.docs.blocks.fragments import fragment
from tests.docs.blocks.pages import Block, blocks
from tests.docs.blocks.programs import AROUND_C, PROGRAMS_ELSEWHERE
from tests.firmware_sim.ecu_in_c import exported

ALL = blocks()
C = [block for block in ALL if block.language == "c" and (block.page, "c") not in PROGRAMS_ELSEWHERE]


def of_kind(kind: str) -> Iterator[Block]:
    return (block for block in ALL if (found := fragment(block)) is not None and found.kind == kind)


def test_settings_are_ours(tmp_path):
    for block in of_kind("settings"):
        path = tmp_path / "page.toml"
        path.write_text(block.text, encoding="utf-8")
        load_config(path, [])


def test_options_are_of_settings():
    for block in of_kind("options"):
        lines = [line.partition("#")[0] for line in block.text.splitlines()]
        given = [one.replace(" ", "") for line in lines for one in re.findall(r"[\w.]+ ?= ?\S+", line)]
        assert given
        load_config(None, given)


def test_files_of_others_are_read():
    for block in of_kind("ini"):
        read = configparser.ConfigParser()
        read.read_string(block.text)
        assert read.sections()
    for block in of_kind("json"):
        assert all(json.loads(line) for line in block.text.splitlines())


def test_toml_is():
    for block in ALL:
        if block.language == "toml":
            tomllib.loads(block.text)


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> Path:
    """Of a small release, with the ECU."""
    return exported(tmp_path_factory.mktemp("library")).folder


@pytest.mark.parametrize("block", C, ids=str)
def test_c_compiles_in_its_library(block, library, tmp_path, shared_builds):
    before, after = AROUND_C[block.page, block.first]
    contents = {path.name: path.read_bytes() for path in library.iterdir() if path.suffix == ".h"}
    contents["page.c"] = f"{before}\n{block.text}\n{after}\n".encode()
    shared_builds.compile_c(contents, tmp_path / "page.o", compiler=host_compiler(), flags=("-c",))


def test_what_stands_around_c_is_of_a_page():
    assert {(block.page, block.first) for block in C} == AROUND_C.keys()
