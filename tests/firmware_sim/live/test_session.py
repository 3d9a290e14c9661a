"""The live loop is the loop of a run, whatever is set on it meanwhile."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.interface import BusState
from can_bridge.command_gate import Intervention
from can_bridge.secoc.key import write_key
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Reason
from contract.errors import StillwakeError
from ecu.fail_safe import OperatingMode
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.simulation import Simulation, Spans, Wired, wire
from firmware_sim.live.loop import live_run
from firmware_sim.live.loop.noticing import BOOT, FIRST_SEEN, UNPOWERED, noticed
from firmware_sim.live.settings import ACTIONS
from firmware_sim.runs.run_log import Row, RunLog
from tests.ecu.conftest import make_bundle
from tests.examples import examples
from tests.firmware_sim.bench.harness import NAMES, LiveOscillator, Waves
from tests.firmware_sim.live.harness import CONFIG, LEAD_IN, Live

_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
_KNOWN = st.fixed_dictionaries({}, optional={name: _JSON for name in (*ACTIONS, "id")})
_NAMES = st.sampled_from(["enable", "controller", "plant", "noise", "dead", "bias", "weights", "babble"])
_SET = st.fixed_dictionaries({"set": st.dictionaries(_NAMES, _JSON | st.just(10**400), max_size=2)})


@pytest.fixture
def live() -> Live:
    return Live()


class Watched:
    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.rows, self.frames = list[Row](), list[Frame]()
        self._patch = monkeypatch
        monkeypatch.setattr(live_run, "wire", self._wire)

    def _wire(self, *parts: Any, **others: Any) -> Wired:
        self.wired = wire(*parts, capture=self.frames.append, **others)
        period = self.wired.loop.period

        def watched(*, enable_request: bool) -> Row:
            self.rows.append(period(enable_request=enable_request))
            return self.rows[-1]

        self._patch.setattr(self.wired.loop, "period", watched)
        return self.wired


def same_as_a_run(live: Live, watched: Watched, texts: tuple[str, ...]) -> None:
    """What the session has done is, to the bit, the run with these disturbances."""
    periods, frames = len(watched.rows), list[Frame]()
    spans = Spans(lead_in=LEAD_IN, controlled=0.2 * periods - LEAD_IN, settle=0.0, averages=False)
    parts: Any = {"controller": Waves(), "disturbances": Disturbances.parse(texts)}
    again = Simulation(make_bundle(), CONFIG, spans=spans, **parts).run(LiveOscillator(CONFIG), capture=frames.append)
    wired = watched.wired
    done = RunLog.of(watched.rows, 10, wired.loop.totals(), again.metadata, traffic=wired.traffic())
    for name, values in again.series.items():
        if name != "step_ms":
            np.testing.assert_array_equal(done.series[name], values, err_msg=name)
    assert (done.bus, done.traffic, done.enabled_at) == (again.bus, again.traffic, again.enabled_at)
    assert live.made["python"].status() == again.metadata.status
    assert watched.frames == frames
    # What viewers get are these rows.
    assert live.rows["k"] == list(range(periods))
    for name in ("t", "Cd", "Cl", "base_Cp", "action", "mode", "reason"):
        np.testing.assert_allclose(live.rows[name], again.series[name], atol=1e-9, err_msg=name)


def test_what_is_set_disturbs_as_the_same_texts_disturb_a_run(monkeypatch):
    """Each item draws from the place that it has among all. Left alone until then, it is an ordinary run."""
    watched = Watched(monkeypatch)
    live = Live().run(15)
    assert live.rows["requested"] == [0] * 10 + [1] * 5
    live.set(noise=0.5).run(5).set(loss=0.25).run(10).set(noise=0.8, dead=NAMES[2], delay_ms=50).run(10)
    live.set(noise=0.0, loss=0.3, babble=True).run(12).set(babble=False, delay_ms=0).run(3)
    assert live.state == "FAULT"
    live.ask(clear=True)
    live.run(20)
    assert live.state == "CONTROL"
    live.ask(power_cycle=True)
    assert live.run(20).state == "STANDBY"
    assert live.set(enable=False).run(3).set(enable=True).run(10).state == "CONTROL"
    live.set(controller="off").run(30).set(controller="python").run(30)
    # Longer without commands than the vehicle bears: it has withdrawn its request.
    assert (live.state, live.heard["now"]["given_up"]) == ("ARMED", True)
    live.ask(clear=True)
    assert live.run(10).state == "CONTROL"
    texts = ["noise:level=0.5@0.3..0.6", "ecu:drop:probability=0.25,at=receive@0.4..0.8"]
    # What stands behind one that changes ends with it, and begins again.
    texts += ["noise:level=0.8@0.6..0.8", f"dead:sensor={NAMES[2]}@0.6..0.8", "vehicle:delay:delay_s=0.05@0.6..1.04"]
    texts += [f"dead:sensor={NAMES[2]}@0.8..1.1", "vehicle:babble@0.8..1.04"]
    texts += ["ecu:drop:probability=0.3,at=receive@0.8..1.1"]
    # A request that was taken back by "clear all", and by hand; a power cycle, and a time without supply.
    texts += ["no_request@1.1..1.16", "reset@1.5", "no_request@1.9..1.96", "reset:boot_s=0.8@2.16"]
    same_as_a_run(live, watched, (*texts, "no_request@3.36..3.38"))


def test_a_request_by_a_viewer_needs_no_lead_in_and_a_refusal_ends_it():
    asked = Live().run(3).set(enable=True).run(5)
    assert asked.rows["requested"] == [0] * 3 + [1] * 5
    asked.ask(restart=True)
    asked.run(12)
    assert (asked.heard["hello"]["run"], asked.rows["requested"][8:]) == (2, [0] * 10 + [1] * 2)
    refused = Live().run(3).set(enable=False).run(20)
    refused.ask(restart=True)
    assert not any(refused.run(20).rows["requested"])


@pytest.mark.parametrize("key", ["", "bus.key"])
def test_another_controller_goes_on_from_the_state_of_the_one_before(key, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_key(Path("bus.key"), bytes(range(1, 17)))
    live = Live(config=replace(CONFIG, bus=replace(CONFIG.bus, key=key)))
    live.run(30).set(controller="c").run(5)
    assert list(live.made) == ["python", "c"]
    assert live.heard["now"]["computed_by"] == "waves by c"
    live.set(weights={"drag_mean": 2.0}).run(5)
    assert live.made["c"].calibration.weights.drag_mean == 2.0
    assert set(live.rows["mode"][15:]) == {2}
    live.set(weights=None).run(1)
    assert live.made["c"].calibration.weights == live.bundle.manifest.mpc.weights
    live.set(controller="python").set(weights={"lift": 3.0}).run(1)
    assert live.made["python"].calibration.weights.lift == 3.0
    live.clocks.clear()
    live.set(controller="c").run(2).ask(restart=True)
    assert live.clocks == ["python", "c"]  # each of them may be chosen in this run
    assert live.run(20).state == "CONTROL"
    assert live.heard["now"]["k"] == 19


def test_an_ecu_that_is_asked_for_and_can_be_had_is_made_ahead():
    work = dict.fromkeys(("c", "mcu"), lambda: None)
    session = Live(ahead=work.get).session
    assert session.before({"set": {"controller": "c", "noise": 0.1}}) is work["c"]
    for other in (
        *({"set": {"controller": name}} for name in ("python", ["c"], "mcu")),
        *({"set": "c"}, {"clear": True}, 3),
    ):
        assert session.before(other) is None, other


def test_what_cannot_be_had_is_one_line_and_changes_nothing():
    def wake(name: str) -> LiveOscillator:
        if name != "wake":
            raise StillwakeError("no recording")
        return LiveOscillator(CONFIG)

    live = Live(wake=wake).run(12)
    live.refused = {"c"}
    before = live.heard["settings"]
    for values, message in (
        ({"controller": "mcu"}, "needs the extra mcu"),
        ({"controller": "c", "noise": 0.5}, "no compiler for c"),
        ({"noise": 0.5, "loss": 2}, "must be in 0..1"),
        ({"dead": "upper_0"}, "must be one of none, upper_39"),
        ({"plant": "recording", "babble": True}, "no recording"),
        ({"weights": 3}, "must be an object with the names"),
    ):
        error = live.ask(set=values)["error"]
        assert message in error and "\n" not in error, values
    for name, value in {"set": 3, "pause": 1, "restart": False}.items():
        assert f"request: {name} must be" in live.ask(**{name: value})["error"], name
    live.run(5)
    assert live.heard["settings"] == before
    assert (len(live.rows["k"]), live.heard["now"]["run"]) == (17, 1)


def test_the_means_are_those_of_the_oscillator():
    """Cd = 1 + cos(t)^2, whose mean over whole cycles is 1.5; the solver's step costs a percent."""
    live = Live(lead_in=20.0).run(99)
    now = live.heard["now"]
    assert now["uncontrolled_Cd"] == pytest.approx(1.5, rel=0.01)
    assert now["drag_Cd"] == pytest.approx(1.5, rel=0.01)
    assert now["reduction_percent"] == pytest.approx(0.0, abs=1.0)
    drag = live.run(1).heard["now"]["uncontrolled_Cd"]
    assert live.run(60).heard["now"]["uncontrolled_Cd"] == drag
    early = Live().run(20).heard["now"]
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
        "CONTROL to HOLD: no pressures arrived; the last command is held",
        "HOLD to DECAY: no pressures arrived; the command is halved each period",
        "DECAY to FAULT: no pressures arrived; the jets are shut until the request falls and rises again",
        "all pressure frames reach the ECU",
        "cleared; the request is withdrawn for a moment, since only a new request starts control",
        "FAULT to CONTROL: the jets follow the controller",
    ]
    assert live.state == "CONTROL"
    live.events.clear()
    live.set(loss=0.5).run(200)
    # 50 losses in 4 s: each of the two ways there once, and then after 1, 2, 4 s.
    assert 1 <= len([text for text in live.events if "to HOLD" in text]) <= 8


def test_what_is_cleared_stays_so_when_something_else_is_set_at_once():
    """What has acted may latch a fault some periods later."""
    for fault, periods in (({"babble": True}, 4), ({"delay_ms": 200}, 16)):
        live = Live().run(60).set(**fault).run(periods)
        live.ask(clear=True)
        assert live.set(controller="python").run(80).state == "CONTROL", fault


def test_paused_it_stands_still_and_still_takes_settings(live):
    live.run(15).ask(pause=True)
    live.run(5)
    assert (len(live.rows["k"]), live.heard["now"]["paused"]) == (15, True)
    live.set(noise=0.5).hear()
    assert live.heard["settings"]["settings"]["noise"] == 0.5
    live.ask(pause=False)
    live.run(5)
    assert (len(live.rows["k"]), live.heard["now"]["paused"]) == (20, False)
    # Of a run that begins in a pause, every viewer learns that it is paused.
    live.ask(pause=True)
    live.ask(restart=True)
    live.run(5)
    assert live.rows["k"][20:] == [0]
    assert (live.heard["now"]["run"], live.heard["now"]["paused"]) == (2, True)


@pytest.fixture(scope="module")
def fuzzed() -> Live:
    return Live().run(1)


@pytest.mark.slow  # many requests
@examples(10)
@given(requests=st.lists(_JSON | _KNOWN | _SET, max_size=4))
def test_whatever_comes_gets_an_answer(requests: list[Any], fuzzed):
    for request in requests:
        answer = fuzzed.session.handle(request)
        assert set(answer) <= {"error", "note"}
        assert "\n" not in answer.get("error", "")
        json.dumps(answer, allow_nan=False)
    fuzzed.run(1)


CONTROL = FIRST_SEEN._replace(state="CONTROL")


def test_each_change_is_reported_once():
    for now, expected in [
        (CONTROL, []),
        (CONTROL._replace(state="HOLD", reason=Reason.STREAM_LOST), ["CONTROL to HOLD: no pressures arrived"]),
        (CONTROL._replace(state="FAULT", reason=Reason.IMPLAUSIBLE), ["the pressures contradict each other; the jets"]),
        (CONTROL._replace(set_aside=("base_0",)), ["base_0 is set aside"]),
        (CONTROL._replace(given_up=True), ["the vehicle ends control"]),
        (CONTROL._replace(gate=Intervention.RATE | Intervention.RANGE), ["limited to the jets' range", "largest step"]),
        (CONTROL._replace(nodes={"ECU": BusState.BUS_OFF}), ["ECU: CAN controller bus"]),
        (CONTROL._replace(state=UNPOWERED), ["CONTROL to UNPOWERED: no supply"]),
    ]:
        kinds, texts = zip(*noticed(CONTROL, now), strict=True) if expected else ((), ())
        assert ("vehicle" in kinds) == now.given_up, now
        assert len(texts) == len(expected), now
        assert all(part in text for part, text in zip(expected, texts, strict=True)), now
        assert list(noticed(now, now)) == [], now


def test_every_state_and_reason_has_words():
    for state in (*OperatingMode.__members__, UNPOWERED, BOOT):
        before = FIRST_SEEN._replace(state="ARMED" if state == "INIT" else "INIT")
        assert len(list(noticed(before, FIRST_SEEN._replace(state=state)))) == 1
    for reason in set(Reason) - {Reason.NONE}:
        assert list(noticed(CONTROL, CONTROL._replace(reason=reason)))
