"""Whether a recording is whole already, or another one lies in its place."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from contract.errors import DatasetError, OutputError
from contract.recording.dataset import Episode, read
from wake.recording.episode_job import EpisodeJob

_NOT_COMPARED: Final = "versions"
"""Versions of the software are not compared: a recording is the same whichever version made it."""


def is_finished(output: Path, jobs: Sequence[EpisodeJob]) -> bool:
    """Whether the file holds all episodes of these jobs, made with the same settings; False if there is no file.

    Rounds that were added to it under a controller do not count. Raises OutputError if there is a file, but not of this
    recording; the message names the first difference.
    """
    if not output.exists():
        return False
    try:
        there = read(output).episodes
    except DatasetError as error:
        raise OutputError(f"{output}: there is a file that is not read ({error}); {_WAYS}") from error
    difference = _difference(there, jobs)
    if difference:
        raise OutputError(f"{output}: holds another recording ({difference}); {_WAYS}")
    return True


_WAYS: Final = "give --overwrite to replace it, or another name"


def _difference(there: Sequence[Episode], jobs: Sequence[EpisodeJob]) -> str | None:
    """The first thing in which the episodes differ from what the jobs would record."""
    by_name = {episode.name: episode for episode in there}
    for job in jobs:
        plan, episode = job.plan, by_name.pop(job.plan.name, None)
        if episode is None:
            return f"it has no episode {plan.name}, but {', '.join(item.name for item in there)}"
        if len(episode) != plan.steps:
            return f"episode {plan.name} has {len(episode)} steps, not {plan.steps}"
        made, wanted = dict(episode.provenance), json.loads(json.dumps(job.provenance))
        made.pop(_NOT_COMPARED, None)
        if made.get("start_sha256") == wanted.get("start_sha256"):
            # The same state, whatever its file was called.
            made.pop("start", None)
        difference = _first("", made, wanted)
        if difference:
            return f"episode {plan.name} has {difference}"
    others = [name for name, episode in by_name.items() if "round" not in episode.provenance]
    return f"it also has episode {others[0]}" if others else None


def _first(name: str, there: Any, here: Any) -> str | None:
    """The first entry with two values; one that another version did not keep is passed over."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        common = sorted(there.keys() & here.keys())
        differences = (_first(f"{name}.{key}".lstrip("."), there[key], here[key]) for key in common)
        return next((text for text in differences if text), None)
    return None if there == here else f"{name} = {there}, not {here}"
