"""The command line as a user meets it: its help, its version, and what works from one end to the other."""

import subprocess
import sys
from importlib.metadata import version

import pytest

from contract.recording import dataset
from docs import command_line

VERBS = list(command_line.commands())


def test_without_a_verb_it_lists_them_and_the_version_is_the_installed_one(cli):
    outcome = cli()
    assert outcome.code != 0
    assert all(verb.split()[0] in outcome.out + outcome.err for verb in VERBS)
    assert cli("--version").out == f"stillwake {version('stillwake')}\n"


@pytest.mark.processes
def test_it_starts_without_what_a_vehicle_does_not_install():
    extras = ("h5py", "torch", "numba", "scipy", "matplotlib", "distributed")
    script = f"import sys; sys.modules.update(dict.fromkeys({extras!r})); import stillwake.__main__"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


@pytest.mark.slow
def test_rounds_under_a_controller_are_added(cli, tmp_path, short_release, coarse):
    output = tmp_path / "a.h5"
    for number in (1, 2):
        what = ("controlled=2", "--episodes", 1, "--role", "train", *coarse.words)
        outcome = cli("record", output, "--under", short_release, *what)
        assert (outcome.code, outcome.err) == (0, "")
        assert f"round {number}, 2 control steps under the controller" in outcome.out.replace("\n", " ")
    found = dataset.read(output).episodes
    assert [(one.name, one.role, len(one)) for one in found] == [
        ("controlled_1_0", "train", 2),
        ("controlled_2_0", "train", 2),
    ]
    assert found[0].provenance["bundle"] == "random"
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]
