"""The folder of a campaign: its label, the initial states and results of its runs, and its report.

campaign.json           the label: settings, seed, spans and bundle; a call with a different label is refused
starts/phase_0.npz      initial flow state of the runs; NAME.phase_0.npz if scenario NAME has its own plant
runs/NAME.phase0.json   the outcome of a finished run
table.csv, figures/, report.html
"""

import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from contract.atomic import check_writable, replacing
from contract.errors import ConfigError, OutputError
from contract.typed import typed
from firmware_sim.campaign.outcome import RunOutcome

CAMPAIGN_SCHEMA: Final = "stillwake-campaign/1"
_RUN_SCHEMA: Final = "stillwake-campaign-run/1"


class CampaignFolder:
    """Paths and files of one campaign."""

    def __init__(self, path: Path) -> None:
        self.path, self.figures = path, path / "figures"
        self.table, self.report = path / "table.csv", path / "report.html"
        self._label_file, self._runs = path / "campaign.json", path / "runs"

    def start(self, phase: int, scenario: str = "") -> Path:
        """Return the file with the flow state at a starting phase; without `scenario`, the file of the common plant."""
        return self.path / "starts" / f"{scenario and scenario + '.'}phase_{phase}.npz"

    def check(self, label: Mapping[str, Any], *, overwrite: bool) -> None:
        """Check the folder, without changes. Raises OutputError if it contains foreign files or, without `overwrite`, a
        campaign with another label; StillwakeError if the folder cannot be written."""
        check_writable(self.path, folder=True)
        if not self.path.exists() or not any(self.path.iterdir()):
            return
        present = _read(self._label_file, CAMPAIGN_SCHEMA)
        if present is None:
            raise OutputError(f"{self.path}: holds files that no campaign wrote; name another folder")
        if present != _plain(label) and not overwrite:
            names = ", ".join(sorted(n for n in present.keys() | label.keys() if present.get(n) != label.get(n)))
            raise OutputError(
                f"{self.path}: holds a campaign with other {names}; give --overwrite to replace it, or another folder"
            )

    def claim(self, label: Mapping[str, Any]) -> None:
        """Write the label. First delete the files of another campaign, because `check` has allowed its replacement."""
        if _read(self._label_file, CAMPAIGN_SCHEMA) != _plain(label):
            for folder in ("starts", "runs", "figures"):
                shutil.rmtree(self.path / folder, ignore_errors=True)
            for file in (self.table, self.report):
                file.unlink(missing_ok=True)
        with replacing(self._label_file) as temporary:
            temporary.write_text(json.dumps(label, indent=2, sort_keys=True) + "\n", encoding="utf-8")

    def outcome(self, name: str, key: str) -> RunOutcome | None:
        """Return the finished run of this name and key; None if its file is missing, damaged or of another version."""
        tree = _read(self._runs / f"{name}.json", _RUN_SCHEMA)
        if tree is None:
            return None
        del tree["schema"]
        try:
            kept = typed(tree, RunOutcome)
        except (ValueError, RecursionError, ConfigError):
            return None
        return kept if kept.key == key else None

    def keep(self, name: str, outcome: RunOutcome) -> None:
        """Write a run, completely or not at all. A failed run is not written: the next call computes it again."""
        if not outcome.failure:
            content = {"schema": _RUN_SCHEMA, **asdict(outcome)}
            with replacing(self._runs / f"{name}.json") as temporary:
                temporary.write_text(json.dumps(content, sort_keys=True) + "\n", encoding="utf-8")

    @property
    def finished(self) -> int:
        return sum(1 for _ in self._runs.glob("*.json"))


def _read(path: Path, schema: str) -> dict[str, Any] | None:
    """Return the content of a JSON file; None if the file is missing, damaged or of another schema."""
    try:
        tree: Any = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return tree if isinstance(tree, dict) and tree.get("schema") == schema else None


def _plain(label: Mapping[str, Any]) -> Any:
    """Return the label as it would be read back after it was written as JSON."""
    return json.loads(json.dumps(label))
