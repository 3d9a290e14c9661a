"""What a campaign leaves in its folder, and which other things it keeps out."""

import pytest

from contract.errors import OutputError, StillwakeError
from firmware_sim.campaign.folder import SCHEMA, CampaignFolder
from firmware_sim.campaign.outcome import Outcome
from tests.firmware_sim.campaign.conftest import phase_of

LABEL = {"schema": SCHEMA, "seed": 1, "settings": {"a": [1, 2]}}


def test_finished_runs_are_kept_by_their_keys_until_another_campaign_may_replace_them(tmp_path) -> None:
    folder = CampaignFolder(tmp_path / "campaign")
    folder.check(LABEL, overwrite=False)
    assert not folder.path.exists()
    folder.claim(LABEL)
    folder.keep("one", phase_of().under)
    folder.keep("two", Outcome(key="k", failure="it diverged"))
    folder.table.write_text("table")
    assert folder.outcome("one", "k") == phase_of().under
    assert folder.outcome("one", "another key") is folder.outcome("two", "k") is None
    # The same campaign goes on, another one is refused by the name of what differs.
    folder.check(LABEL, overwrite=False)
    folder.claim(LABEL)
    other = {**LABEL, "seed": 2}
    with pytest.raises(OutputError, match="other seed;"):
        folder.check(other, overwrite=False)
    folder.check(other, overwrite=True)
    assert folder.finished == 1
    folder.claim(other)
    assert folder.finished == 0
    assert not folder.table.exists()


def test_a_folder_of_something_else_is_never_touched(tmp_path) -> None:
    (tmp_path / "mine").write_text("text")
    for overwrite in (False, True):
        with pytest.raises(OutputError, match="no campaign"):
            CampaignFolder(tmp_path).check(LABEL, overwrite=overwrite)
    with pytest.raises(StillwakeError, match="it is a file"):
        CampaignFolder(tmp_path / "mine").check(LABEL, overwrite=True)
    assert (tmp_path / "mine").read_text() == "text"
