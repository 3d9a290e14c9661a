"""The live loop is the loop of a run, whatever is set on it meanwhile, and what it saves is such a run."""

import gc
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.logs.log_reader import read_messages
from can_bridge.wire.frame import Frame
from contract.errors import StillwakeError
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.simulation import Simulation
from firmware_sim.bench.spans import Spans
from firmware_sim.live import event_log, saving
from firmware_sim.live.requests import ACTIONS
from firmware_sim.runs import run_log, wake_stills
from firmware_sim.runs.run_folder import RunFolder
from tests.examples import examples
from tests.firmware_sim.bench.harness import NAMES, LiveOscillator, Waves
from tests.firmware_sim.conftest import make_bundle
from tests.firmware_sim.live.harness import CONFIG, ENABLE_AFTER, Live, shown
from wake.plant.sample import Sample


@pytest.fixture
def live(tmp_path, monkeypatch) -> Live:
    """Its saved runs have no pictures and no report, which take seconds."""
    for name in ("draw", "write_report"):
        monkeypatch.setattr(saving, name, lambda *arguments: None)
    return Live(tmp_path)


def same_as_a_run(live: Live, saves) -> run_log.RunLog:
    """What the session saves is, to the bit, the run that its own texts describe."""
    folder = RunFolder(saves / live.ask(save=True)["saved"])
    saved, frames = run_log.load(folder.series), list[Frame]()
    periods = len(saved.series["t"])
    again = Simulation(
        make_bundle(),
        CONFIG,
        spans=Spans(lead_in=ENABLE_AFTER, controlled=0.2 * periods - ENABLE_AFTER, settle=0.0, averages=False),
        controller=Waves(),
        disturbances=Disturbances.parse(one.text for one in saved.metadata.faults),
    ).run(LiveOscillator(CONFIG), capture=frames.append)
    for name, values in again.series.items():
        if name != "step_ms":
            np.testing.assert_array_equal(saved.series[name], values, err_msg=name)
    assert [one.acted for one in saved.metadata.faults] == [one.acted for one in again.metadata.faults]
    assert saved.traffic.nodes == again.traffic.nodes
    assert (saved.bus, saved.traffic, saved.enabled_at) == (again.bus, again.traffic, again.enabled_at)
    assert saved.metadata.status == again.metadata.status
    assert live.rows["k"] == list(range(periods))
    np.testing.assert_allclose(live.rows["Cd"], saved.series["Cd"], atol=1e-9)
    logged = [(item.arbitration_id, bytes(item.data)) for item in read_messages(folder.frames)]
    assert logged == [(frame.frame_id, frame.data) for frame in frames]
    return saved


def test_what_is_set_disturbs_as_the_same_texts_disturb_a_run(live, tmp_path):
    """Each item draws from the place that it has among all. Left alone until then, it is an ordinary run."""
    assert live.run(15).rows["requested"] == [0] * 10 + [1] * 5
    live.set(noise=0.5).run(5).set(loss=0.25).run(10).set(noise=0.8, dead=NAMES[2], delay_ms=50).run(10)
    live.set(noise=0.0, loss=0.3, babble=True).run(12).set(babble=False, delay_ms=0).run(3)
    assert live.state == "FAULT"
    live.ask(clear=True)
    live.run(20)
    assert live.state == "CONTROL"
    live.ask(power_cycle=True)
    assert live.run(20).state == "STANDBY"
    assert live.set(enable=False).run(3).set(enable=True).run(10).state == "CONTROL"
    live.set(controller="off").run(30).set(controller="int8").run(30)
    # Longer without commands than the vehicle bears: it has withdrawn its request.
    assert (live.state, live.heard["now"]["given_up"]) == ("ARMED", True)
    live.ask(clear=True)
    assert live.run(10).state == "CONTROL"
    saved = same_as_a_run(live, tmp_path)
    texts = [one.text for one in saved.metadata.faults]
    assert texts[:3] == ["noise:level=0.5@0.3..0.6", "ecu:drop:probability=0.25,at=receive@0.4..0.8", texts[2]]
    assert f"dead:sensor={NAMES[2]}@0.8..1.1" in texts
    assert "vehicle:babble@0.8..1.04" in texts
    assert "reset@1.5" in texts
    assert [text for text in texts if text.startswith("no_request")][1] == "no_request@1.9..1.96"


def test_a_request_by_a_viewer_needs_no_lead_in_and_a_refusal_ends_it(tmp_path):
    asked = Live(tmp_path).run(3).set(enable=True).run(5)
    assert asked.rows["requested"] == [0] * 3 + [1] * 5
    asked.ask(restart=True)
    asked.run(12)
    assert (asked.heard["hello"]["run"], asked.rows["requested"][8:]) == (2, [0] * 10 + [1] * 2)
    refused = Live(tmp_path).run(3).set(enable=False).run(20)
    refused.ask(restart=True)
    assert not any(refused.run(20).rows["requested"])


def test_another_controller_goes_on_from_the_state_of_the_one_before(live):
    live.run(30).set(controller="c").run(5)
    assert list(live.made) == ["int8", "c"]
    assert live.heard["now"]["computed_by"] == "waves by c"
    live.set(weights={"drag_mean": 2.0}).run(5)
    assert live.made["c"].calibration.weights.drag_mean == 2.0
    assert set(live.rows["mode"][15:]) == {2}
    live.set(weights=None).run(1)
    assert live.made["c"].calibration.weights == live.bundle.manifest.mpc.weights
    live.set(controller="int8").set(weights={"lift": 3.0}).run(1)
    assert live.made["int8"].calibration.weights.lift == 3.0
    live.set(controller="c").run(2).ask(restart=True)
    assert live.run(20).state == "CONTROL"
    assert live.heard["now"]["k"] == 19


def test_an_ecu_that_is_asked_for_and_can_be_had_is_made_ahead(tmp_path):
    work = dict.fromkeys(("c", "cortex-m7"), lambda: None)
    session = Live(tmp_path, ahead=work.get).session
    for asked in ({"set": {"controller": "c"}}, {"query": "noise=0.1&controller=c"}):
        assert session.before(asked) is work["c"], asked
    for other in (
        *({"set": {"controller": name}} for name in ("int8", ["c"], "cortex-m7")),
        *({"set": "c"}, {"query": "enable=c"}, {"query": 3}, {"clear": True}, 3),
    ):
        assert session.before(other) is None, other


def test_what_cannot_be_had_is_one_line_and_changes_nothing(tmp_path):
    def wake(name: str) -> LiveOscillator:
        if name != "wake":
            raise StillwakeError("no recording")
        return LiveOscillator(CONFIG)

    live = Live(tmp_path, wake=wake).run(12)
    live.refused = {"c"}
    before = live.heard["settings"]
    for values, message in (
        ({"controller": "cortex-m7"}, "needs the extra mcu"),
        ({"controller": "c", "noise": 0.5}, "no compiler for c"),
        ({"noise": 0.5, "loss": 2}, "must be in 0..1"),
        ({"dead": "upper_0"}, "must be one of none, upper_39"),
        ({"plant": "recording", "babble": True}, "no recording"),
        ({"weights": 3}, "must be numbers by the names"),
    ):
        error = live.ask(set=values)["error"]
        assert message in error and "\n" not in error, values
    for name, value in {"set": 3, "query": 5, "pause": 1, "save": False}.items():
        assert f"request: {name} must be" in live.ask(**{name: value})["error"], name
    live.run(5)
    assert live.heard["settings"] == before
    assert (len(live.rows["k"]), live.heard["now"]["run"]) == (17, 1)


def test_the_means_are_those_of_the_oscillator(tmp_path):
    """Cd = 1 + cos(t)^2, whose mean over whole cycles is 1.5; the solver's step costs a percent."""
    live = Live(tmp_path, enable_after=20.0).run(99)
    now = live.heard["now"]
    assert now["uncontrolled_Cd"] == pytest.approx(1.5, rel=0.01)
    assert now["drag_Cd"] == pytest.approx(1.5, rel=0.01)
    assert now["reduction_percent"] == pytest.approx(0.0, abs=1.0)
    drag = live.run(1).heard["now"]["uncontrolled_Cd"]
    assert live.run(60).heard["now"]["uncontrolled_Cd"] == drag
    early = Live(tmp_path).run(20).heard["now"]
    assert (early["uncontrolled_Cd"], early["reduction_percent"]) == (None, None)


def test_the_plan_is_ahead_of_the_rows_in_which_it_shows(live):
    """The wave of the controller changes from step to step, its pending action does not."""
    live.run(40)
    now = live.heard["now"]
    pending = now["plan"][0]
    live.run(1)
    assert now["plan_from"] == 40
    # Reached in the sample that begins row 40, to the step of the wire.
    assert live.rows["action"][40] == pytest.approx(pending, abs=1e-5)
    assert len(now["plan"]) == len(now["forecast"]) == live.bundle.manifest.mpc.horizon
    live.set(controller="off").run(1)
    assert (live.heard["now"]["plan"], live.state, live.heard["now"]["computed_by"]) == ([], "UNPOWERED", "")


def test_the_bus_is_what_the_nodes_send(live):
    live.run(80)
    for message in live.heard.values():
        json.dumps(message, allow_nan=False)
    bus = live.heard["bus"]
    senders = {"Pressure": "vehicle", "VehicleSpeed": "vehicle", "JetCommand": "ECU", "EcuStatus": "ECU"}
    assert {row["name"]: row["sender"] for row in bus["rows"]} == senders
    assert {row["rate_hz"] for row in bus["rows"]} == {50.0}
    assert all(row["e2e_state"] == "VALID" and 0 < row["age_ms"] <= row["limit_ms"] == 20 for row in bus["rows"])
    live.set(babble=True).run(55)
    unknown = live.heard["bus"]["rows"][0]
    # 500 kbit/s carry at most 4,504 classic frames of 8 bytes a second.
    assert (unknown["id"], unknown["name"], unknown["sender"]) == (0, "unknown", "babbler")
    assert 3800 < unknown["rate_hz"] <= 4504
    assert live.heard["bus"]["load"] > 0.99
    assert live.heard["bus"]["rows"][1]["e2e"] == "NO_NEW_DATA"


def test_events_report_what_the_ecu_does_about_a_fault_and_count_what_comes_again(live):
    live.run(30).set(loss=1.0).run(10).ask(clear=True)
    live.run(15)
    begin = live.events.index("100 % of the pressure frames do not reach the ECU")
    assert live.events[begin : begin + 7] == [
        "100 % of the pressure frames do not reach the ECU",
        "CONTROL to HOLD: no pressures came; the last command stays",
        "HOLD to DECAY: no pressures came; the command is halved each period",
        "DECAY to FAULT: no pressures came; the jets are shut until the request falls and rises again",
        "all pressure frames reach the ECU",
        "cleared; the request is taken back for a moment, since only a new one leads on",
        "FAULT to CONTROL: the jets follow the controller",
    ]
    assert live.state == "CONTROL"
    live.events.clear()
    live.set(loss=0.5).run(200)
    # 50 losses in 4 s: each of the two ways there once, and then after 1, 2, 4 s.
    assert 1 <= len([text for text in live.events if "to HOLD" in text]) <= 8
    assert any("again" in text for text in live.events)


def test_what_is_cleared_stays_so_when_something_else_is_set_at_once(tmp_path):
    """What has acted may latch a fault some periods later."""
    for fault, periods in (({"babble": True}, 4), ({"delay_ms": 200}, 16)):
        live = Live(tmp_path).run(60).set(**fault).run(periods)
        live.ask(clear=True)
        assert live.set(controller="int8").run(80).state == "CONTROL", fault


def test_a_link_reproduces_the_settings(tmp_path, live):
    live.run(20).set(noise=0.25, biased=NAMES[1], bias=-2.0, delay_ms=40, weights={"lift": 0.5}).run(1)
    link = live.heard["settings"]["query"]
    other = Live(tmp_path).run(3)
    assert other.ask(query=link) == {}
    other.run(20)
    assert other.heard["settings"] == live.heard["settings"]
    # The lead-in was not cut short by a link made under control.
    assert other.rows["requested"] == [0] * 10 + [1] * 13
    assert "must be" in other.ask(query="noise=9")["error"]


def test_paused_it_stands_still_and_still_takes_settings(live):
    live.run(15).ask(pause=True)
    live.run(5)
    assert (len(live.rows["k"]), live.heard["now"]["paused"]) == (15, True)
    live.set(noise=0.5).hear()
    assert live.heard["settings"]["settings"]["noise"] == 0.5
    live.ask(pause=False)
    live.run(5)
    assert (len(live.rows["k"]), live.heard["now"]["paused"]) == (20, False)


@pytest.mark.slow  # draws a report
def test_the_latest_periods_are_saved_when_the_first_are_gone(tmp_path):
    live = Live(tmp_path, kept=100).run(30).set(noise=0.5).run(70).set(noise=0.0, loss=0.2).run(50)
    (tmp_path / "live-20260102-120000").mkdir()
    answer = live.ask(save=True)
    assert answer == {"saved": "live-20260102-120000-2"}
    folder = RunFolder(tmp_path / answer["saved"])
    log = run_log.load(folder.series)
    np.testing.assert_allclose(log.series["t"], 0.2 * np.arange(50, 150))
    assert (len(log.series["t"]), log.enabled_at) == (100, 0)
    noise, loss = log.metadata.faults
    # It acted in every period; of the 70, fifty are kept.
    assert (noise.text, noise.acted) == ("noise:level=0.5@0.6..2.0", 50)
    assert loss.text == "ecu:drop:probability=0.2,at=receive@2.0.."
    # Four frames a period, of which none was lost on the bus itself.
    assert log.traffic.frames == pytest.approx(400, abs=2)
    assert json.loads(folder.summary.read_text())["started_with"]["flow"] == "period 50 of a live session"
    assert "noise:level=0.5@0.6..2.0" in folder.report.read_text()


def test_it_is_saved_what_computed_and_from_when_on(live, tmp_path):
    live.run(150).set(controller="c").run(20).set(weights={"lift": 0.5}).run(5)
    metadata = run_log.load(RunFolder(tmp_path / live.ask(save=True)["saved"]).series).metadata
    assert metadata.computed_by.endswith("from 3 s waves by c; from 3.4 s calibration of the cost: lift 0.5")
    assert metadata.weights.lift == 0.5


def test_a_run_that_cannot_be_written_leaves_nothing(tmp_path):
    live = Live(tmp_path / "saves")
    assert "no period" in live.ask(save=True)["error"]
    live.run(5)
    (tmp_path / "saves").write_text("a file in the way")
    assert "cannot write" in live.ask(save=True)["error"]
    assert sorted(tmp_path.iterdir()) == [tmp_path / "saves"]


@pytest.mark.usefixtures("live")
def test_the_flow_is_shown_and_saved(tmp_path):
    live = Live(tmp_path, wake=shown, enable_after=0.4).run(4)
    width, height = live.heard["hello"]["raster"]
    assert len(live.pictures) == 4
    levels = np.frombuffer(live.pictures[-1][-width * height :], np.int8).reshape(height, width)
    # Counter-clockwise above the middle.
    assert levels[: height // 3].mean() > 20 and levels[-height // 3 :].mean() < -20
    folder = RunFolder(tmp_path / live.ask(save=True)["saved"])
    stills = wake_stills.load(folder.wake, run_log.load(folder.series))
    assert np.abs(stills.levels(3).astype(int) - levels).mean() < 3.0


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
_KNOWN = st.sampled_from(["enable", "controller", "plant", "noise", "dead", "bias", "weights", "babble"])


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory) -> Live:
    """Nothing can be saved: a file is where the folder should be."""
    saves = tmp_path_factory.mktemp("fuzz") / "saves"
    saves.touch()
    return Live(saves).run(1)


@pytest.mark.slow  # many requests
@examples(16)
@given(
    requests=st.lists(
        _JSON
        | st.fixed_dictionaries({}, optional={name: _JSON for name in (*ACTIONS, "id")})
        | st.fixed_dictionaries({"set": st.dictionaries(_KNOWN, _JSON | st.just(10**400), max_size=2)})
        | st.fixed_dictionaries({"query": st.text("noise=&%1abc;+.", max_size=20)}),
        max_size=4,
    )
)
def test_whatever_comes_gets_an_answer(requests: list[Any], fuzzed):
    for request in requests:
        answer = fuzzed.session.handle(request)
        assert set(answer) <= {"error", "note", "saved"}
        assert "\n" not in answer.get("error", "")
        json.dumps(answer, allow_nan=False)
    fuzzed.run(1)


class Forgetful(LiveOscillator):
    def sample(self) -> Sample:
        self.seen.clear()
        return super().sample()


@pytest.mark.slow  # four rounds of everything that a page has
def test_rounds_of_clicks_leave_what_one_left(tmp_path, monkeypatch):
    """Everything that is kept is a ring. Counted in objects: tracing the memory itself takes a minute."""
    monkeypatch.setattr(event_log, "KEPT", 10)
    live = Live(tmp_path, wake=lambda name: Forgetful(CONFIG), kept=40)
    counts = []
    for rounds in (2, 2):
        for _ in range(rounds):
            live.set(noise=0.5, dead=NAMES[0], loss=0.2).run(20)
            live.set(noise=0.2, delay_ms=50, babble=True, weights={"lift": 0.5}).run(15)
            live.ask(power_cycle=True)
            live.set(controller="off").run(5).set(controller="c", biased=NAMES[1]).run(10)
            live.ask(query="loss=2")
            live.ask(clear=True)
            live.run(50)
            # What the page has of it is the page's.
            live.made.clear()
            for kept in (*live.rows.values(), live.events, live.pictures, live.controller.calls):
                kept.clear()
        gc.collect()
        counts.append(len(gc.get_objects()))
    assert live.session.messages() == []
    # Less than one for each thing that is clicked in two rounds.
    assert counts[1] - counts[0] < 6, counts
