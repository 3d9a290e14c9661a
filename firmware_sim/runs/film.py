"""The part of a run that its film shows."""

from contract.errors import ConfigError
from firmware_sim.runs.run_log import RunLog
from wake.pictures.film import AFTER, BEFORE, Story


def story_of(log: RunLog, begin: float | None = None, end: float | None = None) -> Story:
    """From some cycles before control began to when it has calmed the wake, or between the times given, in t_c.

    Raises:
        ConfigError: if the run has no time without control before time with it, or the film would not show the change.
    """
    t, first = log.series["t"], log.enabled_at
    if not 0 < first < len(t):
        raise ConfigError("film: the run has no time without control before time with it")
    control = float(t[first])
    story = Story(
        begin=max(0.0, control - BEFORE) if begin is None else begin,
        end=min(float(t[-1]), control + AFTER) if end is None else end,
        control=control,
        drag_before=float(log.series["Cd"][:first].mean()),
    )
    if not story.begin < control < story.end:
        raise ConfigError(
            f"film: {story.begin:g} to {story.end:g} t_c does not show the beginning of control at {control:g} t_c"
        )
    return story
