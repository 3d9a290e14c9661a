"""What a campaign leaves in its folder, and which other things it keeps out."""

import pytest

from contract.errors import OutputError, StillwakeError
from firmware_sim.campaign.folder import CAMPAIGN_SCHEMA, CampaignFolder, RunOutcome
from tests.firmware_sim.campaign.conftest import phase_of

LABEL = {"schema": CAMPAIGN_SCHEMA, "seed": 1, "settings": {"a": [1, 2]}}


def test_a_run_is_kept_by_its_key_and_another_campaign_refused_by_what_differs(tmp_path) -> None:
    folder = CampaignFolder(tmp_path / "campaign")
    folder.check(LABEL, overwrite=False)
    assert not folder.path.exists()
    folder.claim(LABEL)
    path, without_control = folder.path / "runs" / "one.json", RunOutcome(key="k", figures=phase_of().free.figures)
    for outcome in (without_control, phase_of(in_control=3, latches=1, broken=["it broke"]).under):
        folder.keep("one", outcome)
        assert folder.outcome("one", "k") == outcome
        whole = path.read_bytes()
        folder.keep("one", outcome)
        assert path.read_bytes() == whole
    assert folder.outcome("one", "another key") is None
    # A damaged file counts as missing.
    damaged = [b"[]", b"{}", b'{"schema": "stillwake-campaign-run/1"}', b"\xff", b"null"]
    for content in (*damaged, *(whole[:length] for length in range(0, len(whole) - 1, 7))):
        path.write_bytes(content)
        assert folder.outcome("one", "k") is None, content
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
        with pytest.raises(OutputError, match="no campaign wrote"):
            CampaignFolder(tmp_path).check(LABEL, overwrite=overwrite)
    with pytest.raises(StillwakeError, match="it is a file"):
        CampaignFolder(tmp_path / "mine").check(LABEL, overwrite=True)
    assert (tmp_path / "mine").read_text() == "text"
