"""The files of a run folder."""

from pathlib import Path

from contract.atomic import check_writable
from contract.errors import StillwakeError


class RunFolder:
    """The files that `stillwake run` writes.

    Attributes:
        series, summary: files of `run_log.RunLog` and of `summary.whole_summary` as JSON.
        frames: log of every frame on the bus, in the format of candump.
        uncontrolled_picture, controlled_picture: vorticity at the end of the lead-in and of the run.
        wake: file of `wake_stills.WakeStills`; missing in folders of earlier versions.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.series, self.wake = path / "series.npz", path / "wake.npz"
        self.frames, self.summary, self.report = path / "frames.log", path / "summary.json", path / "report.html"
        self.uncontrolled_picture = path / "vorticity_uncontrolled.png"
        self.controlled_picture = path / "vorticity_controlled.png"

    def check_free(self, *, overwrite: bool) -> None:
        """Check the folder. Raises StillwakeError if the folder cannot be written, contains other files, or contains a
        run and `overwrite` is False. A folder with only an OpenFOAM case's developed state is accepted."""
        check_writable(self.path, folder=True)
        there = {item.name for item in self.path.iterdir()} if self.path.is_dir() else set()
        holds_a_run = {self.series.name, self.summary.name} & there
        if there - {"openfoam"} and not holds_a_run:
            raise StillwakeError(f"{self.path}: holds files that no run wrote; name another folder")
        if not overwrite and holds_a_run:
            raise StillwakeError(f"{self.path} holds a run: give another folder, or --overwrite to replace it")
