"""Mutants of the command gate: each is a gate with one small mistake, which the gate's tests must notice.

mutmut makes them all at once and chooses one by a switch, so that a mutant costs a run of the tests in a process that
has imported everything. The tests that depend on chance (hypothesis) are left out: what is killed is killed in every
run. Copies of the packages and of the one test file lie in a folder of their own, and no setting of the project's test
suite reaches them.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from contract.errors import StillwakeError, install

ROOT: Final = Path(__file__).parents[3]
GATE: Final = "can_bridge/command_gate.py"
TESTS: Final = "tests/can_bridge/test_command_gate.py"
_SETTINGS: Final = f"""\
[mutmut]
source_paths={GATE}
also_copy=
    can_bridge
    contract
pytest_add_cli_args=
    -m
    not hypothesis
    -p
    no:cacheprovider
pytest_add_cli_args_test_selection=tests
"""
_RESULT: Final = re.compile(r"^\s*(\S+): (.+)$", re.MULTILINE)
_CHANGED: Final = re.compile(r"^[+-](?!\+\+|--).*$", re.MULTILINE)
"""A line of a diff that was taken out or put in."""
KILLED: Final = ("killed", "caught by type check")


def measure(*, gate: Path = ROOT / GATE, tests: Path = ROOT / TESTS) -> dict[str, Any]:
    """Make every mutant of the gate, or of another file, and run a file of tests on it; a minute. Raises StillwakeError
    if mutmut is missing, or the tests fail on the gate as it is."""
    try:
        tool = version("mutmut")
    except PackageNotFoundError as error:
        raise StillwakeError(f"mutation testing needs mutmut: {install('dev')}") from error
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for package in ("can_bridge", "contract"):
            shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copyfile(gate, folder / GATE)
        (folder / "tests").mkdir()
        shutil.copyfile(tests, folder / "tests" / tests.name)
        (folder / "setup.cfg").write_text(_SETTINGS, encoding="utf-8")
        _mutmut(folder, "run", "--max-children", "2")
        results = dict(_RESULT.findall(_mutmut(folder, "results", "--all", "true")))
        survivors = [
            {"mutant": mutant, "status": status, "change": _CHANGED.findall(_mutmut(folder, "show", mutant))}
            for mutant, status in sorted(results.items())
            if status not in KILLED
        ]
    if not results:
        raise StillwakeError(f"mutmut {tool} made no mutants of {gate}")
    return {
        "gate_mutants": len(results),
        "gate_mutants_survived": len(survivors),
        "gate_survivors": survivors,
        "gate_mutation_tool": f"mutmut {tool}",
    }


def _mutmut(folder: Path, *arguments: str) -> str:
    command = [sys.executable, "-m", "mutmut", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        output = " ".join((done.stdout + done.stderr).split())[-300:]
        raise StillwakeError(f"mutmut {arguments[0]} ended with status {done.returncode}: {output}")
    return done.stdout
