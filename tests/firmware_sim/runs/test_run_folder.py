"""Whether a run may be written into a folder."""

import pytest

from contract.errors import StillwakeError
from firmware_sim.runs.run_folder import RunFolder


def test_a_new_folder_and_one_with_other_things_are_free(tmp_path):
    RunFolder(tmp_path / "new").check_free(overwrite=False)
    (tmp_path / "openfoam").mkdir()
    RunFolder(tmp_path).check_free(overwrite=False)


def test_another_run_is_replaced_only_when_asked_and_a_file_is_no_folder(tmp_path):
    for name in ("series.npz", "summary.json"):
        folder = tmp_path / name[:3]
        folder.mkdir()
        (folder / name).write_text("")
        with pytest.raises(StillwakeError, match="holds a run: give another folder, or --overwrite"):
            RunFolder(folder).check_free(overwrite=False)
        RunFolder(folder).check_free(overwrite=True)
        with pytest.raises(StillwakeError, match=rf"cannot write .*{name}: it is a file"):
            RunFolder(folder / name).check_free(overwrite=True)
