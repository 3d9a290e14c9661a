import json
import os

import pytest

from can_bridge.secoc import freshness_store
from can_bridge.secoc.freshness_store import FreshnessStore
from can_bridge.secoc.securing import LARGEST_HALF, Freshness, verified
from can_bridge.wire.message_specs import PRESSURE_SECURED
from contract.errors import BusError, StillwakeError
from tests.refused import refused

SPEC = PRESSURE_SECURED


def test_every_start_is_another_power_cycle_counted_before_it_is_used(tmp_path, key, monkeypatch):
    """When the count cannot be written, there is no authentication with which to send."""
    assert [FreshnessStore(tmp_path / "node").begin(key).trip for _ in range(4)] == [1, 2, 3, 4]
    assert [path.name for path in tmp_path.iterdir()] == ["node"]

    def fails(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fails)
    with pytest.raises(StillwakeError, match="No space left"):
        FreshnessStore(tmp_path / "node").begin(key)
    monkeypatch.undo()
    assert json.loads((tmp_path / "node").read_text())["trip"] == 4


def test_what_was_accepted_is_refused_after_a_restart(tmp_path, key, genuine):
    store = FreshnessStore(tmp_path / "ecu", every=50)
    state = store.begin(key).verifier(SPEC)
    recorded = [genuine(SPEC, trip=3, count=count) for count in range(120)]
    for frame in recorded:
        state = verified(state, [frame], spec=SPEC, key=key).state
        store.accepted(SPEC.frame_id, state.freshness)
    older = genuine(SPEC, trip=2, count=10**6)

    again = FreshnessStore(tmp_path / "ecu").begin(key)
    state = again.verifier(SPEC)
    assert (again.trip, again.freshness) == (2, Freshness(trip=2))
    replayed = verified(state, [older, *recorded], spec=SPEC, key=key)
    # What stays open: the frames since the last write, fewer than 50.
    passed = [frame.timestamp_ns for frame in replayed.frames]
    assert passed == list(range(101, 120))
    # After the first genuine frame nothing recorded passes.
    state = verified(state, [genuine(SPEC, trip=3, count=120)], spec=SPEC, key=key).state
    assert not verified(state, [older, *recorded], spec=SPEC, key=key).frames


def test_another_power_cycle_of_the_sender_is_kept_at_once(tmp_path, key, genuine):
    store = FreshnessStore(tmp_path / "ecu", every=10**6)
    store.begin(key)
    store.accepted(SPEC.frame_id, Freshness(trip=8).value)
    state = FreshnessStore(tmp_path / "ecu").begin(key).verifier(SPEC)
    assert not verified(state, [genuine(SPEC, trip=7, count=LARGEST_HALF)], spec=SPEC, key=key).frames
    assert verified(state, [genuine(SPEC, trip=8, count=1)], spec=SPEC, key=key).frames


def test_a_damaged_file_is_refused_and_kept(tmp_path, key):
    """Counting from 1 again in silence would use values twice."""
    fields = [
        *('"trip": -1, "heard": {}', '"trip": true, "heard": {}', '"trip": 1.5, "heard": {}', '"trip": 1, "heard": []'),
        *('"trip": 1, "heard": {"x": 1}', '"trip": 1, "heard": {"290": 18446744073709551616}'),
    ]
    bodies = [f'{{"schema": "{freshness_store.FRESHNESS_SCHEMA}", {each}}}' for each in fields]
    other = '{"schema": "stillwake-freshness/2", "trip": 1, "heard": {}}'
    for content in ("", "null", "[]", "{}", other, *bodies, "[" * 100_000, "\udcff"):
        path = tmp_path / "node"
        path.write_text(content, errors="surrogateescape")
        with refused(BusError, "not a freshness file"):
            FreshnessStore(path).begin(key)
        assert path.read_bytes() == content.encode(errors="surrogateescape"), content


def test_power_cycles_end_and_a_place_that_cannot_be_written_is_one_line(tmp_path, key):
    path = tmp_path / "node"
    path.write_text(json.dumps({"schema": freshness_store.FRESHNESS_SCHEMA, "trip": LARGEST_HALF, "heard": {}}))
    with pytest.raises(BusError, match="start with another key"):
        FreshnessStore(path).begin(key)
    with pytest.raises(StillwakeError, match="node"):
        FreshnessStore(path / "node").begin(key)
    with pytest.raises(ValueError, match="every 0"):
        FreshnessStore(path, every=0)
