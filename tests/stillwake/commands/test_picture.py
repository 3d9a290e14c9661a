"""`stillwake picture` as a user meets it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from PIL import Image
from PIL.GifImagePlugin import GifImageFile

from contract.config.tree import Config
from contract.errors import StillwakeError
from firmware_sim.runs import run_log
from stillwake.commands.picture import actions_of
from tests.firmware_sim.runs.conftest import shedding_log

pytestmark = pytest.mark.slow  # figures are drawn and written


def actions(**settings: Any) -> np.ndarray:
    return actions_of(Config(), **{"duration": None, "forcing": "none", **settings})


def test_stills_of_a_state(cli, tmp_path):
    assert cli("picture", tmp_path / "v.png", "--sensors", "upper_39, base_0").code == 0
    assert cli("picture", tmp_path / "p.png", "--field", "pressure").code == 0
    assert Image.open(tmp_path / "v.png").size == Image.open(tmp_path / "p.png").size == (1100, 341)


def test_a_mean_flow_prints_its_bubble(printed, tmp_path, coarse):
    out = printed("picture", tmp_path / "m.png", "--field", "mean", "--duration", 0.6, "--settle", 0.2, *coarse.words)
    # Backward flow reaches about a width behind the base; over three samples it is not a mean to quote.
    assert 0.3 < float(out.split("bubble length ")[1].split()[0]) < 2.0
    assert (tmp_path / "m.png").is_file()


def test_an_animation_of_a_forced_wake(cli, tmp_path, coarse):
    forcing = ["--forcing", "sine:amplitude=0.05,frequency=0.3"]
    words = ("--duration", 0.6, "--every", 2, "--width", 500, *forcing, *coarse.words)
    assert cli("picture", tmp_path / "a.gif", *words).code == 0
    assert GifImageFile(tmp_path / "a.gif").n_frames == 2


def test_a_replayed_run_reaches_the_actions_that_were_in_force(tmp_path, run_metadata):
    in_force = [0.0, 0.01, 0.03, -0.02]
    log = shedding_log(run_metadata)
    four = {name: values[:4] for name, values in log.series.items()} | {"action": np.array(in_force)}
    log = replace(log, series=four, enabled_at=0)
    run_log.save(tmp_path / "series.npz", log)
    assert actions(forcing=str(tmp_path)).tolist() == in_force[1:]
    assert actions(forcing=str(tmp_path), duration=0.4).tolist() == in_force[1:3]
    with pytest.raises(StillwakeError, match=r"--duration 2\.0: the recording is 0\.6 t_c long"):
        actions(forcing=str(tmp_path), duration=2.0)
    own = run_metadata.config
    slower = replace(run_metadata, config=replace(own, flow=replace(own.flow, control_period=0.1)))
    cases = ((slower, "control_period is 0.1 in the run, but 0.2"), (replace(slower, drive="a"), "drive"))
    for other, message in cases:
        run_log.save(tmp_path / "series.npz", replace(log, metadata=other))
        with pytest.raises(StillwakeError, match=message):
            actions(forcing=str(tmp_path))


def test_actions_that_do_not_exist_are_refused():
    for settings, message in (
        ({"forcing": "sine:amplitude=0.2"}, r"amplitude = 0\.2: must be between 0 and 0\.075"),
        ({"forcing": "sine:frequency=3"}, r"frequency = 3\.0: must be positive and below 2\.5"),
        ({"forcing": "chirp:amplitude=0.01"}, "with a name of no parameter"),
        ({"forcing": "training:seed=0.5"}, "seed must be a whole number"),
        ({"forcing": "sine:amplitude=high"}, "must be numbers"),
        ({"forcing": "nowhere"}, "nowhere/series.npz"),
    ):
        with pytest.raises(StillwakeError, match=message):
            actions(**settings)
