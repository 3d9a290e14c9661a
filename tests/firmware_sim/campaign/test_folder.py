"""What a campaign leaves in its folder, and which other campaigns it keeps out."""

import pytest

from contract.errors import OutputError, StillwakeError
from firmware_sim.campaign.folder import SCHEMA, CampaignFolder
from firmware_sim.campaign.outcome import Outcome
from tests.firmware_sim.campaign.conftest import phase_of

LABEL = {"schema": SCHEMA, "seed": 1, "settings": {"a": [1, 2]}}


@pytest.fixture
def folder(tmp_path) -> CampaignFolder:
    made = CampaignFolder(tmp_path / "campaign")
    made.check(LABEL, overwrite=False)
    assert not made.path.exists()
    made.claim(LABEL)
    made.keep("one", phase_of().under)
    made.table.write_text("table")
    return made


def test_a_finished_run_is_found_by_its_key(folder) -> None:
    assert folder.outcome("one", "k") == phase_of().under
    assert folder.outcome("one", "another key") is None
    assert folder.outcome("two", "k") is None
    assert folder.finished == 1


def test_a_run_that_did_not_finish_is_not_kept(folder) -> None:
    folder.keep("two", Outcome(key="k", failure="it diverged"))
    assert folder.finished == 1


def test_the_same_campaign_goes_on(folder) -> None:
    folder.check(LABEL, overwrite=False)
    folder.claim(LABEL)
    assert folder.finished == 1


def test_another_campaign_is_refused_by_the_name_of_what_differs(folder) -> None:
    with pytest.raises(OutputError, match="other seed;"):
        folder.check({**LABEL, "seed": 2}, overwrite=False)
    assert folder.finished == 1


def test_another_campaign_may_replace_it_when_asked_to(folder) -> None:
    other = {**LABEL, "seed": 2}
    folder.check(other, overwrite=True)
    assert folder.finished == 1
    folder.claim(other)
    assert folder.finished == 0
    assert not folder.table.exists()


def test_a_folder_of_something_else_is_never_touched(tmp_path) -> None:
    for overwrite in [False, True]:
        (tmp_path / "mine").write_text("text")
        with pytest.raises(OutputError, match="no campaign"):
            CampaignFolder(tmp_path).check(LABEL, overwrite=overwrite)
        assert [path.name for path in tmp_path.iterdir()] == ["mine"], overwrite


def test_a_file_in_the_place_is_refused(tmp_path) -> None:
    (tmp_path / "file").write_text("text")
    with pytest.raises(StillwakeError, match="it is a file"):
        CampaignFolder(tmp_path / "file").check(LABEL, overwrite=True)
