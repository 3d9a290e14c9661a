"""The part of a run that its film shows."""

import pytest

from contract.errors import ConfigError
from examples.film_of_a_run import story_of


def test_it_begins_before_control_and_counts_from_the_drag_there_or_is_refused(shedding, log_of) -> None:
    log = shedding(Cd=0.8, Cl=0.0)
    story = story_of(log)
    # Control is requested at 12 t_c; the run ends 20 t_c later.
    control = log.series["t"][60]
    assert (story.begin, story.drag_before) == pytest.approx((control - 11.0, 1.1))
    assert (story.control, story.end) == (control, log.series["t"][-1])
    asked = story_of(log, begin=control - 2.0, end=control + 3.0)
    assert (asked.begin, asked.end) == (control - 2.0, control + 3.0)
    with pytest.raises(ConfigError, match="does not show the beginning of control"):
        story_of(log, begin=log.series["t"][61])
    for enabled_at in (0, 6):
        with pytest.raises(ConfigError, match="must begin without control and continue with control"):
            story_of(log_of(enabled_at=enabled_at))
