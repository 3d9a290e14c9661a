"""The files of a run folder."""

from dataclasses import dataclass
from pathlib import Path

from contract.errors import StillwakeError


@dataclass(frozen=True)
class RunFolder:
    """Where `stillwake run` leaves what came of a run."""

    path: Path

    @property
    def series(self) -> Path:
        """`firmware_sim.runs.run_log.RunLog`."""
        return self.path / "series.npz"

    @property
    def frames(self) -> Path:
        """Every frame on the bus, in candump's format."""
        return self.path / "frames.log"

    @property
    def summary(self) -> Path:
        """`firmware_sim.runs.summary.summary` as JSON."""
        return self.path / "summary.json"

    @property
    def uncontrolled_picture(self) -> Path:
        """Vorticity at the end of the time without control."""
        return self.path / "vorticity_uncontrolled.png"

    @property
    def controlled_picture(self) -> Path:
        """Vorticity at the end of the run."""
        return self.path / "vorticity_controlled.png"

    @property
    def wake(self) -> Path:
        """`firmware_sim.runs.wake_stills.WakeStills`; not in the folder of an earlier version."""
        return self.path / "wake.npz"

    @property
    def report(self) -> Path:
        """The run as one HTML page."""
        return self.path / "report.html"

    def check_free(self, *, overwrite: bool) -> None:
        """Raises StillwakeError if a run cannot be written here, or would replace another one unasked."""
        if self.path.exists() and not self.path.is_dir():
            raise StillwakeError(f"cannot write {self.path}: it is a file, and a run needs a folder")
        if not overwrite and (self.series.exists() or self.summary.exists()):
            raise StillwakeError(f"{self.path} holds a run: give another folder, or --overwrite to replace it")
