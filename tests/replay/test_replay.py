"""The replay detects small faults in both languages, and does not judge recordings that it cannot judge."""

import hashlib
import json
from dataclasses import replace

import pytest

from can_bridge.command_gate import GateLimits
from can_bridge.wire.frame import Frame
from contract.config.loading import load_config
from contract.errors import StillwakeError
from firmware_sim.bench.disturbances import Disturbances
from tests.proofs.ecu_in_c.planted import PLANTED
from tests.replay import __main__ as command
from tests.replay import judging
from tests.replay.__main__ import PROVENANCE
from tests.replay.recording import open_loop, plans, python_ecu, shipped, vehicle
from tests.replay.shelf import SHELF, SUFFIX, Answers, ShelfError, read

DRIVE = SHELF / f"undisturbed{SUFFIX}"


def test_the_shelf_is_as_it_was_recorded_and_small():
    record = json.loads((SHELF / PROVENANCE).read_text(encoding="utf-8"))
    files = {path.name: path.read_bytes() for path in SHELF.glob(f"*{SUFFIX}")}
    assert record["sha256"] == {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    assert sum(map(len, files.values())) < 3_000_000
    assert files.keys() <= {f"{plan.name}{SUFFIX}" for plan in plans(shipped().manifest.sensors)}
    assert {read(SHELF / name).digest for name in files} == {record["digest"]}


def test_every_plan_can_be_driven():
    found = plans(sensors := shipped().manifest.sensors)
    assert len(found) >= 24
    for plan in found:
        with vehicle(plan.settings) as config:
            duration_s = plan.lead_in + plan.controlled
            Disturbances.parse(plan.disturb).check(config, sensors, duration_s=duration_s)
            assert plan.lead_in / 0.02 > shipped().manifest.window
            assert duration_s <= 4.0


@pytest.mark.slow  # 75 control steps, twice
def test_a_constant_of_the_gate_that_is_changed_is_seen_in_python(monkeypatch):
    periods, own = read(DRIVE).periods[:75], GateLimits.from_config(load_config())
    before = open_loop(python_ecu(load_config()), periods)
    wrong = replace(own, step_m2_per_s=0.01 * own.step_m2_per_s)
    monkeypatch.setattr(GateLimits, "from_config", lambda config: wrong)
    after = open_loop(python_ecu(load_config()), periods)
    for exact in (True, False):
        found = judging.verdict("", "python", before, after, exact=exact)
        assert found.periods and found.periods[0] >= 64 and found.largest > judging.ROUNDING
    assert "memory.under_way" in judging.verdict("", "python", before, after).changed


@pytest.mark.proofs  # builds the shipped release; the test above sees a change, and the one below how it is compared
@pytest.mark.compiler
def test_a_line_that_is_changed_is_seen_in_c(tmp_path):
    ((job,), refused) = judging.c_jobs([DRIVE], judging.c_library())
    assert refused == {}
    assert job.sources is not None
    ((_, _, before),) = judging.answers(job)
    assert 2 in before.modes, "never in control"
    (fault,) = (one for one in PLANTED if one.what == "an action is kept as a float")
    ((name, kind, after),) = judging.answers(job._replace(sources=fault.into(dict(job.sources))))
    found = judging.verdict(name, kind, before, after)
    assert found.periods and found.changed[0] == "memory.under_way"
    judging.draw([found], tmp_path / "changed.png")
    assert (tmp_path / "changed.png").read_bytes().startswith(b"\x89PNG")


def test_what_differs_is_counted_and_named():
    one, other = (Frame(frame_id=0x120, data=data) for data in (b"\0", b"\1"))
    states = {"mode": [1, 1, 1], "plan": [4, 5, 6], "gone": [1, 1, 1]}
    old = Answers(frames=[(one,)] * 3, actions=[0.0, 0.01, 0.02], modes=[2] * 3, reasons=[0] * 3, states=states)
    new = replace(old, frames=[(one,), (one,), (other,)], actions=[0.0, 0.01, 0.05])
    new = replace(new, states={"mode": [1, 1, 1], "plan": [4, 0, 0]})
    found = judging.verdict("", "c", old, replace(new, states={**new.states, "gone": [1, 1, 1]}))
    assert (found.periods, found.changed) == ([1, 2], ["plan"])
    assert found.largest == pytest.approx(0.03)
    assert judging.verdict("", "c", old, new).changed == ["gone", "plan"], "a field that is missing"
    assert judging.verdict("", "c", old, old).periods == []
    # Without `exact` only the command, its mode and its reason are compared.
    assert judging.verdict("", "python", old, new, exact=False).periods == [2]
    assert judging.verdict("", "python", old, replace(old, reasons=[0, 1, 0]), exact=False).periods == [1]
    longer = replace(old, frames=[*old.frames, (one,)], actions=[*old.actions, 0.0])
    assert 3 in judging.verdict("", "c", old, longer).periods


def test_a_truncated_file_and_a_shelf_of_another_release_are_not_judged(tmp_path, monkeypatch):
    for kept in (-200, 20, 0):
        (tmp_path / DRIVE.name).write_bytes(DRIVE.read_bytes()[:kept])
        with pytest.raises(ShelfError, match="make replay RENEW=1") as caught:
            read(tmp_path / DRIVE.name)
        assert "\n" not in str(caught.value) and DRIVE.name in str(caught.value)
    monkeypatch.setattr(command, "SHELF", tmp_path)
    with pytest.raises(ShelfError, match="RENEW=1"):
        command.provenance()
    (tmp_path / PROVENANCE).write_text(json.dumps({"release": "other", "digest": "0" * 64}), encoding="utf-8")
    with pytest.raises(StillwakeError, match=r"of other \(0{12}\).*nothing is judged; make replay RENEW=1") as refused:
        command.main()
    assert refused.value.status == 4
