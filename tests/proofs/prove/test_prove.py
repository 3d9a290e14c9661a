"""The machine proofs that take a second each; `make prove` runs all proofs."""

import shutil
import sys
from pathlib import Path

import pytest

from stillwake.parts.c_release import library_folder
from tests.proofs.prove import proof

ITEMS, SABOTAGE = proof.plan()


def test_each_part_has_a_proof_or_a_reason_and_each_sabotage_an_item():
    names = [item.name for item in ITEMS]
    assert len(set(names)) == len(names)
    assert len(SABOTAGE) >= 10 and {one.item for one in SABOTAGE} <= {item.name for item in ITEMS if not item.open}
    for item in ITEMS:
        file, function = item.name.split(".")
        harness = proof.HARNESSES / f"{file}.c"
        assert item.open or f"{function}(void)" in harness.read_text(encoding="utf-8"), item.name


def test_a_limit_a_violation_and_a_crash_are_told_apart(tmp_path: Path):
    item = ITEMS[0]

    def outcome(text: str, status: int = 0) -> proof.Outcome:
        tool = tmp_path / "esbmc"
        tool.write_text(f"#!{sys.executable}\nprint({text!r}); raise SystemExit({status})\n")
        tool.chmod(0o755)
        return proof.tried(item, tmp_path, tool)

    proved = outcome("Generated 12 VCC(s), 3 remaining\nVERIFICATION SUCCESSFUL")
    assert (proved.state, proved.conditions) == ("proved", 12)
    failed = outcome("Violated property:\n  file a.c line 1\n  array bounds violated\n  x\n\nVERIFICATION FAILED", 1)
    assert (failed.state, failed.why) == ("failed", "file a.c line 1 array bounds violated x")
    assert outcome("ERROR: std::bad_alloc", 6).state == "open"
    assert outcome("", 0).state == "open"  # silence proves nothing


@pytest.mark.compiler  # exports the library
@pytest.mark.skipif(proof.tool() is None, reason="ESBMC (extra prove) is not installed")
def test_what_is_quick_is_proved_and_its_sabotage_found(tmp_path: Path):
    esbmc = proof.tool()
    assert esbmc is not None
    with library_folder(None) as folder:
        library = shutil.copytree(folder, tmp_path / "library")
    quick = {item.name: item for item in ITEMS if item.quick}
    for name, item in quick.items():
        found = proof.tried(item, library, esbmc, 60)
        assert found.state == "proved" and found.conditions > 0, (name, found)
    for one in SABOTAGE:
        if one.item in quick:
            assert proof.found_by(one, ITEMS, library, esbmc).state == "failed", one.what
