"""The sensor check in C against the one in Python, to the bit, with the same estimates given to both."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.messages import Reason
from contract.arrays import Array
from contract.config.tree import Config
from contract.controller.estimator import views
from contract.recording import dataset
from contract.release.bundle import load
from contract.runtime.onnx_estimator import OnnxEstimator
from contract.sensor_faults import Bias, Dead, Drift, Swapped, Zero
from contract.shipped import BUNDLE, RECORDING
from export.int8.rounded_estimator import rounded_estimator
from export.to_c.estimator import SIZES, estimator_files
from export.to_onnx.sensor_estimator import build_estimator
from firmware_sim.ecu.sensor_check import SensorCheck, SensorCheckState
from tests.examples import examples
from tests.export.to_c.ecu.sensor_parts import GIVEN, WINDOW, SensorParts, built, by_hypothesis, network

pytestmark = pytest.mark.compiler

ARRAYS = ("residual", "fast", "slow", "noise", "score", "readings", "estimates")
LEVELS = np.array([-0.29, -0.36, -0.41, -0.37])
PHASES = np.array([0.0, 0.4, 3.1, 3.5])


@pytest.fixture(scope="module")
def parts(tmp_path_factory, shared_builds) -> SensorParts:
    sizes = estimator_files(build_estimator(rounded_estimator(network())).SerializeToString())[SIZES]
    return built(
        {SIZES: sizes, "given.c": GIVEN.encode()},
        ["sw_sensors.c"],
        tmp_path_factory.mktemp("sensors"),
        shared_builds.compile_c,
        extra="extern double given[10][4]; extern int first_row;",
    )


class Given:
    """What the estimator of either check says next."""

    def __init__(self) -> None:
        self.by_view = np.zeros((len(views(4)), 4))
        self.seen = np.zeros((WINDOW, 5))

    def estimates(self, window: Array) -> Array:
        self.seen = window
        return self.by_view


class Twins:
    """Both checks, stepped alike and compared after every period."""

    def __init__(self, parts: SensorParts) -> None:
        figures = load(BUNDLE).manifest.sensor_estimator
        assert figures is not None
        self.parts, self.given = parts, Given()
        self.check = SensorCheck.of(figures, self.given, Config().ecu.sensor_check)
        self.state = SensorCheckState.start(window=WINDOW, sensors=4)
        self.c, self.work = parts.ffi.new("sw_sensors *"), parts.ffi.new("sw_estimator_work *")
        self.memory = parts.ffi.new("sw_memory *")
        parts.ffi.buffer(self.c)[:] = b"\xff" * parts.ffi.sizeof("sw_sensors")
        parts.lib.sw_sensors_start(self.c)
        self.window, self.rows = np.zeros((WINDOW, 5)), 0
        self.agree(Reason.NONE, None)

    def step(self, cp: Array | None, by_view: Array, *, skipped: int = 0, emptied: bool = False) -> Reason | None:
        """A period with the readings that came, if any."""
        if emptied:
            self.window, self.rows = np.zeros((WINDOW, 5)), 0
        if cp is not None or self.rows:
            row = np.append(self.window[-1, :4] if cp is None else cp, 0.01 * self.rows)
            self.window = np.concatenate([self.window[1:], row[None]])
            self.rows = min(self.rows + 1, WINDOW)
        self.given.by_view = by_view
        self.parts.lib.given = by_hypothesis(by_view).tolist()
        self.memory.window, self.memory.rows = self.window.tolist(), self.rows
        pointer = self.parts.ffi.NULL if cp is None else self.parts.ffi.new("double[4]", cp.tolist())
        said = self.parts.lib.sw_sensors_next(self.c, self.work, self.memory, pointer, skipped)
        self.state, fault = self.check.next(self.state, self.window, self.rows, cp, skipped=skipped)
        if cp is not None:
            missing = WINDOW - self.rows
            assert np.array_equal(self.given.seen[:missing], self.window[[missing] * missing])
            assert self.parts.lib.first_row == missing
        self.agree(Reason(said), fault)
        return fault

    def agree(self, said: Reason, fault: Reason | None) -> None:
        c, state = self.c, self.state
        assert said == (fault or Reason.NONE)
        assert (c.set_aside, c.doubt) == (-1 if state.set_aside is None else state.set_aside, state.doubt)
        assert bool(c.implausible) == state.implausible
        assert list(c.flat) == state.flat.tolist()
        assert bool(c.judged) == (not np.isnan(state.residual).any())
        assert bool(c.has_read) == (not np.isnan(state.readings).any())
        for name in ARRAYS:
            theirs = np.nan_to_num(getattr(state, name)).ravel()
            assert self.parts.array(getattr(c, name)).tobytes() == theirs.tobytes(), name


def flow(step: int) -> Array:
    """Cp, (4,), of one oscillation."""
    return LEVELS + 0.25 * np.sin(2 * np.pi * step / 30 + PHASES)


def disturbed(kind: str, cp: Array, j: int, k: int, held: Array) -> Array:
    """What becomes of readings under a fault of sensor j, or of j and k."""
    read = cp.copy()
    if kind == "rests":
        read[j] = held[j]
    elif kind == "both rest":
        read[[j, k]] = held[[j, k]]
    elif kind == "all rest":
        read = held
    elif kind == "bias":
        read[j] += 0.3
    elif kind == "two biases":
        read[j], read[k] = read[j] + 0.5, read[k] - 0.4
    elif kind == "exchanged":
        read[[j, k]] = read[[k, j]]
    return read


KINDS = ("sound", "rests", "both rest", "all rest", "bias", "two biases", "exchanged")
PHASE = st.tuples(
    st.sampled_from(KINDS), st.permutations(range(4)), st.integers(1, 80), st.floats(-4.0, 0.0), st.floats(0.0, 0.4)
)


@given(st.integers(0, 2**32), st.lists(PHASE, min_size=1, max_size=4))
@examples(40)
def test_both_checks_have_the_same_bits_after_any_history(parts, seed, phases: Sequence[Any]):
    """Each phase has a fault, the estimator's errors in tens of Cp, and a share of frames that are lost."""
    rng, twins, now = np.random.default_rng(seed), Twins(parts), 0
    for kind, (j, k, *_), periods, error, lost in phases:
        held = flow(now)
        for _ in range(periods):
            read = disturbed(kind, flow(now), j, k, held)
            by_view = flow(now) + 10.0**error * rng.normal(size=(len(views(4)), 4))
            happened = rng.random(3)
            skipped = int(rng.choice([1, 3, 40, 2**61])) if happened[1] < 0.02 else 0
            twins.step(None if happened[0] < lost else read, by_view, skipped=skipped, emptied=bool(happened[2] < 0.01))
            now += 1


UNIT = np.full(4, 0.128)
FAULTS = {
    "none": (None, None),
    "dead": (Zero(2), 2),
    "stuck": (Dead(1), 1),
    "bias": (Bias(2.0, UNIT, 0), 0),
    "other bias": (Bias(-2.0, UNIT, 3), 3),
    "drift": (Drift(2.0, UNIT, 1, steps=100), 1),
    "exchanged": (Swapped(0, 2), None),
}
"""With the sensor that is to be set aside. Levels are in global deviations, 0.128 in Cp."""


@pytest.mark.slow  # some seconds of recorded pressures a fault
@pytest.mark.parametrize("name", FAULTS)
def test_both_checks_say_the_same_of_recorded_pressures_with_planted_faults(parts, name):
    release = load(BUNDLE)
    estimator = OnnxEstimator.of(release)
    assert estimator is not None
    recording = dataset.read(RECORDING)
    episode = next(item for item in recording.episodes if item.role == "test")
    recorded = episode.series["Cp"][:360, recording.layout.indices(release.manifest.sensors)]
    fault, liar = FAULTS[name]
    if fault is not None:
        recorded = np.concatenate([recorded[:160], fault(recorded[160:])])
    twins, said = Twins(parts), set()
    for cp, action in zip(recorded, episode.previous_action, strict=False):
        seen = np.concatenate([twins.window[1:], np.append(cp, action)[None]])
        said.add(twins.step(cp, estimator.estimates(seen)))
        twins.window[-1, 4] = action
    if name == "exchanged":
        assert Reason.IMPLAUSIBLE in said
    else:
        assert (twins.state.set_aside, said) == (liar, {None})


def test_the_comparison_notices_a_planted_difference(parts):
    """A running mean, from its twelfth digit on."""
    twins = Twins(parts)
    for now in range(40):
        twins.step(flow(now), np.tile(flow(now) + 0.01, (len(views(4)), 1)))
    twins.c.score[7][2] *= 1.0 + 1e-12
    with pytest.raises(AssertionError, match="score"):
        twins.step(flow(40), np.tile(flow(40), (len(views(4)), 1)))
