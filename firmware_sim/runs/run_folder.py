"""The files of a run folder."""

from dataclasses import dataclass
from pathlib import Path


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
    def report(self) -> Path:
        """The run as one HTML page."""
        return self.path / "report.html"
