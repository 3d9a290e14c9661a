"""The recorded wake: what comes back, what is kept of a long run, and what is refused."""

import io
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from PIL import Image

from contract.errors import StillwakeError
from firmware_sim.runs.wake_stills import MOST_STILLS, Scene, WakeRecorder, WakeStills, load, save

SCENE = Scene(view=(4.5, 16.5, -2.25, 2.25), size=(96, 36), sensors={"base_0": (7.5, 0.1), "base_1": (7.5, -0.1)})


def street(k: int) -> np.ndarray:
    x, y = np.meshgrid(np.arange(96.0), np.arange(36.0))
    total = np.zeros_like(x)
    for i in range(6):
        distance = (x - (12.0 + 16.0 * i + k) % 96.0) ** 2 + (y - (12.0 if i % 2 else 24.0)) ** 2
        total += (-1) ** i * 110.0 * np.exp(-distance / 30.0)
    return np.clip(np.rint(total), -127, 127).astype(np.int8)


def recorded(times: np.ndarray) -> WakeStills:
    recorder = WakeRecorder(SCENE, len(times))
    for k, t in enumerate(times):
        recorder.record(k, float(t), partial(street, k))
    return recorder.recorded()


def test_levels_come_back_within_the_loss_of_the_codec(log_of, tmp_path):
    log, path = log_of(), tmp_path / "wake.npz"
    save(path, recorded(log.series["t"]))
    loaded = load(path, log)
    assert (loaded.scene, loaded.k.tolist()) == (SCENE, list(range(6)))
    for k in range(6):
        error = loaded.levels(k).astype(int) - street(k)
        # A level is 1/127 of the scale: no one sees 2 % of it, and it has no sign.
        assert np.sqrt(np.mean(error**2)) < 3.0
        assert abs(np.mean(error)) < 0.5
        assert np.abs(error).max() < 25


def test_a_long_run_keeps_as_many_stills_evenly_spaced():
    recorder, asked = WakeRecorder(SCENE, 10 * MOST_STILLS + 1), list[int]()

    def levels(k: int) -> np.ndarray:
        asked.append(k)
        return np.zeros((36, 96), dtype=np.int8)

    for k in range(10 * MOST_STILLS + 1):
        recorder.record(k, 0.2 * k, partial(levels, k))
    wake = recorder.recorded()
    assert MOST_STILLS / 2 < len(wake.stills) <= MOST_STILLS
    assert set(np.diff(wake.k)) == {11}
    assert asked == wake.k.tolist()


def with_a_png(wake: WakeStills) -> WakeStills:
    buffer = io.BytesIO()
    Image.new("L", (96, 36)).save(buffer, format="PNG")
    return replace(wake, stills=(buffer.getvalue(), *wake.stills[1:]))


WRONG = {
    "not in the series": lambda wake: replace(wake, t=wake.t + 0.2),
    r"must increase and be in 0\.\.5": lambda wake: replace(wake, k=wake.k + 1),
    "stills must increase": lambda wake: replace(wake, k=wake.k[::-1]),
    r"6 stills for 5 periods": lambda wake: replace(wake, k=wake.k[:-1]),
    r"must have \(95, 36\)": lambda wake: replace(wake, scene=replace(wake.scene, size=(95, 36))),
    "not a WebP": with_a_png,
    "NaN is not a number": lambda wake: replace(wake, scene=replace(wake.scene, view=(0.0, 1.0, 0.0, float("nan")))),
}


def test_a_damaged_file_or_one_that_contradicts_the_run_is_refused(log_of, tmp_path):
    log = log_of()
    path, wake = tmp_path / "wake.npz", recorded(log.series["t"])
    for message, change in WRONG.items():
        save(path, change(wake))
        with pytest.raises(StillwakeError, match=rf"wake\.npz: not the recorded wake of this run \(.*{message}"):
            load(path, log)
    save(path, wake)
    whole = path.read_bytes()
    middle = len(whole) // 2
    for damaged in (whole[:-100], whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :], b""):
        path.write_bytes(damaged)
        with pytest.raises(StillwakeError, match="not the recorded wake of this run"):
            load(path, log)
