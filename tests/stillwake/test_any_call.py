"""Whatever numbers, paths and words a user gives: a status, at most one line to stderr, nothing half-written.

The work itself is cut off where it begins: only what a command does before it, and how it ends, is looked at.
"""

import os
import shutil
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from random import Random
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.config.listing import sections
from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.recording import dataset
from contract.release import signing
from docs import command_line

ROUNDS = int(os.environ.get("STILLWAKE_CALLS", "3"))
"""Calls of each verb. They are the same in every test run; STILLWAKE_CALLS=500 makes as many more."""
RUNS = 12  # calls of the flow solver until the work counts as begun: a start from rest takes some of them
CONTINUED = (".parts", ".checkpoints")  # what a stopped command keeps, to go on from
BEGINNINGS = (
    *("train.pipeline.fit_joint", "train.refinement.pipeline.refine", "export.release.pipeline.rounded_on"),
    *("export.release.pipeline.lower", "firmware_sim.mcu.measure.compile_for_cortex_m7"),
    *("wake.recording.recorder.run_parallel", "firmware_sim.campaign.conduct.spread"),
    *("wake.pictures.drawing.save_figure", "can_bridge.bus.backends.connection.open_bus"),
    *("can_bridge.tester.transport.open_client", "ecu.daemon.process.serve"),
    *("ecu.daemon.store_service.serve_store", "firmware_sim.latency.running.recorded"),
    "firmware_sim.live.serving.server.serve",
)
"""Where the work of a command begins."""
NUMBERS = (
    *("nan", "inf", "-inf", "1e400", "1e308", "-1e308", "1e-300", "0", "-0.0", "-1", "0.2", "1", "3", "1.5", "1e3"),
    *("9" * 30, "9" * 5000, "2147483648", "9223372036854775808", "1_000", " 1", "0x10", "", "one", "\u0663", "1\n"),
)
WORDS = (
    *("", " ", "[/x]", "[red]x[/red]", ":smile:", "a\x1b[2Jb", "a\nb", "\udcff", "Zürich", "x" * 5000, "0", "-1"),
    *("none", "project", "%s", "{}", "a,b", ",", "../x", "tcp://", "cuda", "base_0", "train", "openfoam"),
)
# No device and no absolute path but of /proc, where nothing can be made: what writes files may replace what is there.
PATHS = (
    *("missing", "missing/deeper/x", "folder", "empty-folder", "file", "file/x", "empty", "bundle", "release.key"),
    *("release.pub", "settings.toml", "frames.log", "link-to-nowhere", "loop", "[/x]", "[red]", ":smile:.npz"),
    *("a\x1b[2Jb", "a\nb", "\udcff", "Zürich", "x" * 300, "x" * 5000, "x/" * 300 + "x", "", " ", ".", "./", "a\\b"),
    *("out.h5", "out.npz", "out.png", "out.gif", "out.mp4", "out.zip", "out.xyz", "/proc/nowhere/x", "-", "~", "file."),
)
SETTINGS = tuple(one.name for section in sections(Config()) for one in section.settings)
USUAL = {("picture", "output"): "out.png", ("develop", "duration"): "1", ("can", "file"): "frames.log"}
"""What a call needs to get past the first check, by verb and parameter."""


def begins(*_arguments: object, **_named: object) -> None:
    raise StillwakeError("work began: everything was accepted")


@pytest.fixture
def no_work(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Let no command get to its work; returns what sets the count of solver runs back."""
    count = [0]

    def run(_solver: object, flow: Any, **_named: object) -> None:
        flow.velocities[:] *= 1.01
        count[0] += 1
        if count[0] > RUNS:
            begins()

    for name in BEGINNINGS:
        # By the module itself: another test may have imported its package again.
        module, _, function = name.rpartition(".")
        monkeypatch.setattr(import_module(module), function, begins)
    read, shipped = dataset.read, cache(dataset.read)
    monkeypatch.setattr(dataset, "read", lambda path: (shipped if path.is_absolute() else read)(path))
    monkeypatch.setattr("wake.solver.navier_stokes.FlowSolver.run", run)
    monkeypatch.setenv("PATH", "")
    return lambda: count.__setitem__(0, 0)


def prepare(folder: Path, release: Path) -> None:
    """Files of each kind that a path may lead to."""
    for name in ("folder", "empty-folder"):
        (folder / name).mkdir(parents=True)
    for name in ("file", "folder/inside"):
        (folder / name).write_text("text\n")
    (folder / "empty").touch()
    (folder / "frames.log").write_text("(1.0) can0 123#00\n(1.1) can0 130##1000102\n")
    (folder / "settings.toml").write_text("[ecu]\ndelay_steps = 1\n")
    (folder / "link-to-nowhere").symlink_to("nowhere")
    (folder / "loop").symlink_to("loop")
    shutil.copytree(release, folder / "bundle")
    signing.write_key_pair(folder, Ed25519PrivateKey.from_private_bytes(bytes(32)))


def listing(folder: Path) -> dict[str, bytes | None]:
    """Every file's bytes by its path, folders and links as None."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() and not path.is_symlink() else None
        for path in sorted(folder.rglob("*"))
        if not any(part.endswith(CONTINUED) for part in path.parts)
    }


def call_of(random: Random, verb: str, command: Any) -> list[str]:
    """The words behind `stillwake` for one of `docs.command_line.commands()`: usual ones, but for one to three."""
    kinds, arguments, options = get_type_hints(command.callback), list[str](), list[str]()
    names = [one.name for one in command.params]
    odd = random.sample(names, min(len(names), random.randint(1, 3)))
    for one in command.params:
        if one.name not in odd and not one.required:
            continue
        if kinds[one.name] is bool:
            options.append(one.opts[0])
            continue
        usual = USUAL.get((verb.split()[0], one.name), "out")
        value = odd_value(random, one.name, kinds[one.name]) if one.name in odd else usual
        # Behind `=`, so that a leading dash is a value; "--" does it for arguments.
        is_option = one.param_type_name == "option"
        (options if is_option else arguments).append(f"{one.opts[0]}={value}" if is_option else value)
    return [*verb.split(), *options, *(["--", *arguments] if arguments else [])]


def odd_value(random: Random, name: str, kind: Any) -> str:
    if name == "given" and random.random() < 0.5:
        return f"{random.choice(SETTINGS)}={random.choice((*NUMBERS, *WORDS))}"
    if get_origin(kind) is Literal:
        return str(random.choice((*get_args(kind), *WORDS)))
    # Of a list and of what may be left out, the inner kind.
    kind = next((inner for inner in get_args(kind) if inner is not NoneType), kind)
    values_of: dict[Any, tuple[str, ...]] = {Path: PATHS, int: NUMBERS, float: NUMBERS}
    return random.choice(values_of.get(kind, (*WORDS, *PATHS)))


@pytest.mark.proofs  # long; refusals by name stay
@pytest.mark.slow  # some calls of every verb
def test_any_call_ends_well(random_release, no_work, cli, tmp_path, monkeypatch) -> None:
    for verb, command in command_line.commands().items():
        random = Random(verb)
        for _ in range(ROUNDS):
            words = call_of(random, verb, command)
            prepare(tmp_path / "place", random_release)
            monkeypatch.chdir(tmp_path / "place")
            before = listing(tmp_path / "place")
            no_work()
            done = cli(*words)
            after = listing(tmp_path / "place")
            shutil.rmtree(tmp_path / "place")
            assert done.code in {0, 1, 2, 3, 4}, (words, done)
            assert "Traceback" not in done.err, words
            assert "\x1b[2J" not in done.out + done.err, words
            assert done.code != 1 or (done.err.startswith("error: ") and done.err.count("\n") == 1), (words, done.err)
            assert done.code == 0 or after == before, (words, set(after) ^ set(before))
