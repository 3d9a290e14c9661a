"""What more than one room's tests need."""

import gc
import os
import shutil
import sys
from base64 import b64decode
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from datetime import date
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from filelock import FileLock
from hypothesis import HealthCheck, settings

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from tests.browser import chromium
from tests.c_builds import MODULES, SharedBuilds

if TYPE_CHECKING:
    import typer
    from playwright.sync_api import Browser

    from contract.arrays import Array
    from contract.model.model_folder import ModelFolder
    from export.program.controller_program import ControllerProgram
    from export.release.gated import Gated
    from tests.ecu.in_c.exported import Exported
    from wake.truck.state import State
    from wake.truck.surface import Surface
    from wake.truck.truck_wake import TruckWake

pytest_plugins = ["tests.budget"]

# `make full` draws examples; `make test` has half as many and `make check` a quarter, the same ones each time, so that
# a change passes or fails by itself. No test fails because another process had the processor.
settings.register_profile("drawn", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("whole", settings.get_profile("drawn"), derandomize=True, max_examples=50)
settings.register_profile("fast", settings.get_profile("whole"), max_examples=25)
settings.load_profile("whole")

SIGNING_KEY = Ed25519PrivateKey.from_private_bytes(bytes(32))
"""Of the bundles that tests sign; the tests that need it make it of the same bytes."""
PROGRAM = "import sys; sys.modules['asammdf'] = None; from stillwake.__main__ import main; main()"
STILLWAKE = (sys.executable, "-c", PROGRAM)
"""In a process of its own; without asammdf, which python-can imports for MF4 files in more time than all else takes."""


def pytest_collection_finish() -> None:
    """What the tests imported lives to the end: the collector need not look through it again and again."""
    gc.collect()
    gc.freeze()


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str


@cache
def kept_command(app: "typer.Typer") -> Any:
    """The app's commands, which typer would read from the signatures again at every call."""
    from typer.main import get_group

    return get_group(app)


@pytest.fixture
def cli(monkeypatch, capsys) -> Callable[..., Outcome]:
    """Run `stillwake` with these arguments, in this process; what typer makes of the app's signatures is kept."""
    import stillwake.__main__

    monkeypatch.setattr("typer.main.get_command", kept_command)

    def run(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["stillwake", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            stillwake.__main__.main()
        code = stop.value.code
        assert code is None or isinstance(code, int)
        return Outcome(0 if code is None else code, *capsys.readouterr())

    return run


@pytest.fixture(scope="session", autouse=True)
def shared_builds(request, tmp_path_factory) -> Iterator[SharedBuilds]:
    """C libraries and programs are compiled once for all tests, workers and sessions."""
    cache = getattr(request.config, "cache", None)
    builds = SharedBuilds(tmp_path_factory.mktemp("builds") if cache is None else cache.mkdir("c_builds"))
    with pytest.MonkeyPatch.context() as patch:
        for module in MODULES:
            patch.setattr(f"{module}.compile_c", builds.quick)
        yield builds


def shared(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A folder that one process of the session fills for all of them; never written to afterwards."""
    root = factory.getbasetemp().parent if "PYTEST_XDIST_WORKER" in os.environ else factory.getbasetemp()
    with FileLock(root / f"{name}.lock"):
        if not (root / name).exists():
            make(unfinished := factory.mktemp(name))
            unfinished.rename(root / name)
    return root / name


@pytest.fixture(scope="session")
def random_release(tmp_path_factory) -> Path:
    """A bundle that is one in every respect but that nobody trained it: int8, the paper's window, small otherwise."""
    return shared(tmp_path_factory, "random", partial(_random_release, window=ModelConfig().window)) / "bundle"


@pytest.fixture(scope="session")
def short_release(tmp_path_factory) -> Path:
    """The same with a window of four rows, whose controller acts from the fourth step on."""
    return shared(tmp_path_factory, "short", partial(_random_release, window=4)) / "bundle"


@pytest.fixture(scope="session")
def release(tmp_path_factory) -> "Exported":
    """A small release with its C library; never written to."""
    from contract.release import bundle
    from tests.ecu.in_c.exported import Exported, exported

    root = shared(tmp_path_factory, "exported", exported)
    return Exported(bundle.load(root / "bundle"), root / "bundle", root / "c")


@pytest.fixture(scope="session")
def short_recording(tmp_path_factory) -> Path:
    """The beginnings of three episodes of the shipped recording, which takes a second to read."""
    return shared(tmp_path_factory, "recording", _short_recording) / "short.h5"


def _short_recording(folder: Path) -> None:
    from contract.recording import dataset
    from contract.shipped import RECORDING

    whole = dataset.read(RECORDING)
    parts = (one for one in whole.episodes if one.name in ("training_1", "none_0", "chirp_0"))
    short = [replace(one, series={name: values[:200] for name, values in one.series.items()}) for one in parts]
    dataset.write(folder / "short.h5", replace(whole, episodes=tuple(short)))


@pytest.fixture(scope="session")
def sources(release) -> dict[str, bytes]:
    from ecu.in_c.c_ecu import ecu_sources
    from tests.ecu.in_c.exported import CONFIG

    return ecu_sources(release.folder, release.bundle, CONFIG)


def _random_release(folder: Path, window: int) -> None:
    from examples.random_programs import random_program
    from export.int8 import rounded_to_nearest
    from export.program.controller_program import random_windows
    from export.release.gated import gate, lower

    model = ModelConfig(window=window, latent=3, lstm_width=8, dynamics_width=16, decoder_width=8)
    program = random_program(1, model=model, mpc=MpcConfig(horizon=8))
    lowered = lower(rounded_to_nearest(program), calibration=(), with_library=False)
    limits = {"rms_action_error": 0.05, "max_cost_gap": 1.0}
    write_random(folder / "bundle", gate(lowered, random_windows(program, 20), limits))


def write_random(path: Path, gated: "Gated") -> None:
    """As a release of the default vehicle that nobody trained."""
    from export.release.pipeline import write_release

    model = model_of(gated.lowered.effective)
    write_release(path, gated, model, name="random", created=date(2026, 1, 2), config=Config())


def model_of(program: "ControllerProgram", **tensors: "Array") -> "ModelFolder":
    """A model of the program's sensors with these tensors of a prior, but without its networks."""
    from contract.model.model_folder import Description, ModelFolder
    from contract.sensors import TRUCK

    description = Description(
        config=Config(),
        scaling=program.scaling,
        sensors=program.sensors,
        layout=TRUCK.only(TRUCK.indices(program.sensors)),
        dataset_sha256="0" * 64,
        metrics={"slim": {"r2": 0.9}},
        ranking={},
        versions={"torch": "2"},
    )
    of_prior = {f"prior.{name}": values for name, values in tensors.items()}
    return ModelFolder(description=description, tensors=of_prior, weights_sha256="1" * 64, config_tree={})


@pytest.fixture(scope="session")
def shared_wake(tmp_path_factory: pytest.TempPathFactory) -> Iterator["TruckWake"]:
    """Of one test process; built before any other plant, so that only one of the processes compiles the kernels and
    their adjoint. Folders whose tests run the plant ask for it in their `conftest.py`. From then on, wakes of the same
    grid and body share what measures on them, which is most of the time that one takes to make, and never changes."""
    from wake.truck.tape import Tape, no_weights
    from wake.truck.truck_wake import TruckWake

    surfaces: dict[object, Surface] = {}
    make = TruckWake._surface

    def shared(wake: TruckWake) -> "Surface":
        key = (wake.config.reynolds, wake.config.refinement, wake.body)
        if key not in surfaces:
            surfaces[key] = make(wake)
        return surfaces[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TruckWake, "_surface", shared)
        with FileLock(tmp_path_factory.getbasetemp().parent / "kernels.lock"):
            wake = TruckWake()
            wake.solver.start()
            tape = Tape(wake, 500.0)
            tape.advance(0.0)
            tape.back(no_weights(len(wake.layout)))
        yield wake


@dataclass(frozen=True)
class Coarse:
    """The developed wake on a grid with a sixth of the cells, whose control period costs a fifteenth; `words` are
    options of commands that run the plant."""

    words: tuple[str, ...]
    flow: FlowConfig
    start: "State"

    def plant(self) -> AbstractContextManager["TruckWake"]:
        from wake.truck.truck_wake import TruckWake

        wake = TruckWake(self.flow)
        wake.reset(self.start)
        return nullcontext(wake)


@pytest.fixture(scope="session")
def coarse(shared_wake, tmp_path_factory) -> Coarse:
    from wake.truck.develop import moved
    from wake.truck.state import developed_state, save_state
    from wake.truck.truck_wake import TruckWake

    flow = FlowConfig(refinement=0.4, substeps=12)
    start = moved(developed_state(), shared_wake.grid, TruckWake(flow), 0.4)
    path = tmp_path_factory.mktemp("coarse") / "start.npz"
    save_state(path, start)
    settings = ("--set", f"flow.refinement={flow.refinement}", "--set", f"flow.substeps={flow.substeps}")
    return Coarse(words=("--state", str(path), *settings), flow=flow, start=start)


@pytest.fixture(scope="session")
def sound(random_release, tmp_path_factory) -> Path:
    """A signed bundle directory; never written to."""
    from contract.release import bundle

    path = tmp_path_factory.mktemp("sound") / "bundle"
    shutil.copytree(random_release, path)
    bundle.sign(path, SIGNING_KEY)
    return path


@pytest.fixture
def signed(sound, tmp_path) -> Path:
    return shutil.copytree(sound, tmp_path / "bundle")


@pytest.fixture
def public_key_file(tmp_path_factory) -> Path:
    from contract.release import signing

    folder = tmp_path_factory.mktemp("keys")
    signing.write_key_pair(folder, SIGNING_KEY)
    return folder / signing.PUBLIC_KEY


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    with chromium() as found:
        yield found


@pytest.fixture
def no_pictures(monkeypatch) -> None:
    """Closed loops and reports draw one grey point in place of each picture: of a short run, that is half the time."""
    point = b64decode("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg==")
    draw = "firmware_sim.bench.closed_loop._draw"
    monkeypatch.setattr(draw, lambda _wake, _bundle, _state, target: target.write_bytes(point))
    monkeypatch.setattr("firmware_sim.runs.pages.png_of", lambda _figure: point)


@pytest.fixture(scope="session")
def run_metadata():
    """What a run was made with; never read from a bundle."""
    from can_bridge.wire.messages import EcuStatus, Mode, Reason
    from firmware_sim.runs.metadata import RunMetadata, RunOrigin

    return RunMetadata(
        controller="random (int8, 0123456789ab)",
        digest="0123456789abcdef" * 4,
        computed_by="a test",
        signer=None,
        plant="two numbers",
        sensors=("upper_39", "lower_39", "base_0", "base_9"),
        mpc=MpcConfig(horizon=8),
        weights=MpcConfig().weights,
        budget_ms=20.0,
        averages=True,
        settle=0.4,
        status=EcuStatus(
            state=Mode.HOLD, reason=Reason(0), overruns=1, missed=2, crc_errors=3, bus_off=4, bundle_hash=2**32 - 1
        ),
        config=Config(),
        origin=RunOrigin(day="2026-01-02", command=("stillwake", "run", "a")),
        versions={"python": "3.11"},
    )
