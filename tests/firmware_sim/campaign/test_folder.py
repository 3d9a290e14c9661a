"""What a campaign leaves in its folder, and which other things it keeps out."""

import pytest

from contract.errors import OutputError, StillwakeError
from firmware_sim.campaign.folder import CAMPAIGN_SCHEMA, CampaignFolder
from tests.firmware_sim.campaign.conftest import phase_of

LABEL = {"schema": CAMPAIGN_SCHEMA, "seed": 1, "settings": {"a": [1, 2]}}


def test_a_run_is_kept_by_its_key_and_another_campaign_refused_by_what_differs(tmp_path) -> None:
    folder = CampaignFolder(tmp_path / "campaign")
    folder.check(LABEL, overwrite=False)
    assert not folder.path.exists()
    folder.claim(LABEL)
    folder.keep("one", phase_of().under)
    assert folder.outcome("one", "k") == phase_of().under
    assert folder.outcome("one", "another key") is None
    other = {**LABEL, "seed": 2}
    with pytest.raises(OutputError, match="other seed;"):
        folder.check(other, overwrite=False)
    folder.check(other, overwrite=True)
    assert folder.finished == 1
    folder.claim(other)
    assert folder.finished == 0


def test_a_folder_of_something_else_is_never_touched(tmp_path) -> None:
    (tmp_path / "mine").write_text("text")
    for overwrite in (False, True):
        with pytest.raises(OutputError, match="not a campaign's"):
            CampaignFolder(tmp_path).check(LABEL, overwrite=overwrite)
    with pytest.raises(StillwakeError, match="it is a file"):
        CampaignFolder(tmp_path / "mine").check(LABEL, overwrite=True)
    assert (tmp_path / "mine").read_text() == "text"
