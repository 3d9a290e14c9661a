"""The paper's episodes of the shipped recording, without those that were recorded under a controller since."""

from pathlib import Path

from contract.recording import dataset
from contract.recording.dataset import Dataset, Episode
from contract.shipped import RECORDING


def of_the_paper(episode: Episode) -> bool:
    return bool(episode.provenance["forcing_signal"] != "controlled")


def paper_file(parts: Path) -> Path:
    """A data set of those episodes alone, in the folder `parts`; written if it is not there."""
    path = parts / "paper.h5"
    if not path.exists():
        parts.mkdir(parents=True, exist_ok=True)
        episodes = tuple(episode for episode in dataset.read(RECORDING).episodes if of_the_paper(episode))
        dataset.write(path, Dataset(episodes=episodes))
    return path
