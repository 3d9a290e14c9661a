"""Many damaged inputs, and that the measurement notices a reader that lets one through."""

from pathlib import Path

import pytest

from contract.errors import BundleError
from tests.proofs.release.bundle_fuzz import KINDS, FuzzError, figures, run_case, sound

CASES = 150


@pytest.mark.slow  # It reads hundreds of bundles.
def test_every_damaged_input_is_refused_by_name_or_harmless(tmp_path):
    found = figures([run_case(tmp_path, 1, number) for number in range(CASES)])
    assert set(found["kinds"]) == set(KINDS)
    # The bound is a second; a busy machine may stall a process for longer than any case takes.
    assert found["slowest_s"] < 3.0
    assert all(sum(row["refused"].values()) > 0.2 * row["cases"] for row in found["kinds"].values())


def test_a_reader_with_a_fault_is_noticed(tmp_path, monkeypatch):
    def refuse(path: Path) -> dict[str, bytes]:
        raise BundleError("\x1b[2J")

    sound()
    for name, fault in (
        ("contract.release.checks._verify_file", lambda *arguments: ""),
        ("contract.release.manifest.strict_json.decode", lambda raw: 1 / 0),
        ("contract.release.bundle.read_files", refuse),
    ):
        with monkeypatch.context() as patch, pytest.raises(FuzzError, match=r"case \d+ of seed 3"):
            patch.setattr(name, fault)
            for number in range(500):
                run_case(tmp_path, 3, number)
