"""A release on the real wake, for a few periods: what the run folder holds, over each kind of frames."""

import json
import secrets

import can
import numpy as np
import pytest

from can_bridge.secoc.key import write_key
from can_bridge.wire.messages import Mode
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.release import bundle
from contract.release.checks import Bundle
from firmware_sim.bench.closed_loop import run_closed_loop
from firmware_sim.bench.simulation import Spans
from firmware_sim.runs import wake_stills
from firmware_sim.runs.run_log import RunFolder
from firmware_sim.runs.run_page.report import write_report
from wake.pictures.fields import LevelPicture

# Whole runs of the loop; the one that is shared has its pictures, since it is made before.
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_pictures")]
LEAD_IN, CONTROLLED = 50, 52  # periods
PERIODS = LEAD_IN + CONTROLLED


@pytest.fixture(scope="module")
def release(random_release) -> Bundle:
    return bundle.load(random_release)


@pytest.fixture(scope="module")
def run(release, coarse, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "new"
    seen = []
    config, spans = Config(flow=coarse.flow), Spans(lead_in=10.0, controlled=10.4, settle=0.4)
    log = run_closed_loop(folder, release, config, spans, plant=coarse.plant(), progress=lambda *at: seen.append(at))
    return folder, log, seen


def logged(folder) -> list[can.Message]:
    with can.CanutilsLogReader(folder / "frames.log") as reader:
        return list(reader)


def test_the_folder_holds_the_run_and_its_page_can_be_written_again_from_it(run):
    folder, _, seen = run
    write_report(RunFolder(folder))
    assert [(done, total) for _, done, total in seen] == [(k + 1, PERIODS) for k in range(PERIODS)]
    names = ("frames.log", "report.html", "series.npz", "summary.json")
    pictures = ("vorticity_controlled.png", "vorticity_uncontrolled.png", "wake.npz")
    assert sorted(path.name for path in folder.iterdir()) == [*names, *pictures]
    first = (folder / "report.html").read_text()
    (folder / "report.html").unlink()
    assert write_report(RunFolder(folder)) == folder / "report.html"
    assert (folder / "report.html").read_text() == first
    messages = logged(folder)
    # Pressures, the speed, a command and a status in every period.
    assert [message.arbitration_id for message in messages] == [0x120, 0x128, 0x130, 0x140] * PERIODS
    assert all(message.is_fd for message in messages)
    times = [message.timestamp for message in messages]
    assert times == sorted(times)
    assert times[4] - times[0] == pytest.approx(0.02, abs=2e-6)
    summary = json.loads((folder / "summary.json").read_text())
    assert [summary[f"frames_{name}"] for name in ("sent", "lost", "rejected")] == [2 * PERIODS, 0, 0]
    assert (summary["fault"], summary["modes"]) == (None, {"CONTROL": CONTROLLED})
    # The developed wake's known ranges.
    assert 0.9 < summary["Cd_uncontrolled"] < 1.3
    assert -1.0 < summary["base_Cp_uncontrolled"] < -0.2


def test_the_recorded_wake_is_the_flow_at_the_start_of_each_period(run, coarse):
    folder, log, _ = run
    stills = wake_stills.load(RunFolder(folder).wake, log)
    assert stills.k.tolist() == list(range(PERIODS))
    # Without control the loop's wake is the solver's own, advanced by hand.
    with coarse.plant() as wake:
        for k in range(4):
            error = stills.levels(k).astype(int) - LevelPicture(wake).levels()
            # The codec's loss; a period off, the far vortices alone differ by five times as much.
            assert np.sqrt(np.mean(error**2)) < 2.5, k
            wake.advance(0.0)


def test_one_setting_authenticates_both_nodes_and_the_key_stays_where_it_is(short_release, coarse, tmp_path):
    secret = secrets.token_bytes(16)
    write_key(tmp_path / "key", secret)
    folder = tmp_path / "run"
    release = bundle.load(short_release)
    config = Config(flow=coarse.flow, bus=BusConfig(key=str(tmp_path / "key")))
    spans = Spans(lead_in=2.0, controlled=2.0, settle=0.0, averages=False)
    log = run_closed_loop(folder, release, config, spans, plant=coarse.plant())
    write_report(RunFolder(folder))
    assert set(log.series["mode"][-5:]) == {Mode.CONTROL}
    assert (log.bus.lost, log.bus.rejected, log.metadata.status.not_authentic) == (0, 0, 0)
    assert [message.arbitration_id for message in logged(folder)] == [0x122, 0x12A, 0x132, 0x142] * 20
    assert json.loads((folder / "summary.json").read_text())["settings"]["bus"]["key"] == str(tmp_path / "key")
    for path in folder.iterdir():
        content = path.read_bytes()
        assert secret not in content and secret.hex().encode() not in content.lower(), path
    assert sorted(path.name for path in tmp_path.iterdir()) == ["key", "run"]
