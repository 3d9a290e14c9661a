"""A table of the bus: sender and rate of each message, the receiver's E2E state, and the nodes' error states."""

from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Final

from can_bridge.bus.simulated.medium import BusActivity, Transmission
from can_bridge.e2e.receiver import GOOD, E2eReceiver, FrameCheck, ReceiverState
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import MessageSet
from contract.config.tree import Config
from firmware_sim.bench.disturbing import PORT_NAMES
from firmware_sim.live.loop.messages import LiveMessage
from firmware_sim.runs.run_log import NodeErrors

ROWS: Final = 64
"""Largest number of rows. If there are more identifiers, the identifiers with the lowest priority are left out."""
_NS: Final = 10**9


@dataclass(kw_only=True, eq=False)
class _Row:
    sender: str
    lately: deque[int]  # number of frames in each period of the latest second
    count: int = 0
    last_ns: int = 0
    seen: int = 0  # number of frames in the present period


class BusTable:
    """A table of a run's bus traffic. Call it with every `Transmission`, and call `period_over` after each period."""

    def __init__(self, config: Config, messages: MessageSet) -> None:
        self._messages, self._period_ns = messages, config.period_ns
        self._periods = max(1, round(_NS / config.period_ns))
        self._rows: dict[tuple[int, bool], _Row] = {}
        self._activity: deque[BusActivity] = deque(maxlen=self._periods + 1)
        # The nodes have no receivers with a readable state for these messages, so the table itself checks the messages.
        specs = messages.speed.spec, messages.status.spec
        self._listeners = {spec.frame_id: E2eReceiver(spec, config.bus.e2e) for spec in specs}
        self._heard: dict[int, list[Frame]] = {frame_id: [] for frame_id in self._listeners}
        self._names = {spec.frame_id: spec.name for spec in messages.specs}

    def __call__(self, seen: Transmission) -> None:
        frame = seen.frame
        key = frame.frame_id, frame.is_extended
        row = self._rows.get(key)
        if row is None:
            # A message that a node's port sends but the node's software does not is from a babbling fault.
            babbles = seen.sender in PORT_NAMES.values() and not self._is_ours(key)
            sender = "babbler" if babbles else seen.sender
            row = self._rows[key] = _Row(sender=sender, lately=deque(maxlen=self._periods))
        row.last_ns = seen.end_ns
        row.count += 1
        row.seen += 1
        if frame.frame_id in self._heard and not frame.is_extended:
            self._heard[frame.frame_id].append(frame)

    def period_over(self, activity: BusActivity) -> None:
        """Count the frames of the period that has ended."""
        for row in self._rows.values():
            row.lately.append(row.seen)
            row.seen = 0
        self._activity.append(activity)
        for frame_id, listener in self._listeners.items():
            listener.tick(self._heard[frame_id])
            self._heard[frame_id] = []

    def message(
        self, run: int, pressures: ReceiverState, commands: ReceiverState, nodes: Mapping[str, NodeErrors]
    ) -> LiveMessage:
        """Return the message about the bus in the latest second of virtual time. `pressures` and `commands` are the
        states of the receivers in the ECU and in the vehicle."""
        first, last = self._activity[0], self._activity[-1]
        receivers = {
            self._messages.pressure.spec.frame_id: pressures,
            self._messages.command.spec.frame_id: commands,
            **{frame_id: listener.state for frame_id, listener in self._listeners.items()},
        }
        passed_ns = last.now_ns - first.now_ns
        # After the first period there are no earlier counts to subtract.
        load = (last.busy_ns - first.busy_ns) / passed_ns if passed_ns else last.load
        return {
            "type": "bus",
            "run": run,
            "rows": [self._row(key, self._rows[key], receivers, last.now_ns) for key in sorted(self._rows)[:ROWS]],
            "load": min(load, 1.0),  # 0 to 1
            "error_frames": last.error_frames - first.error_frames if passed_ns else last.error_frames,
            "nodes": [{"name": name, **asdict(errors)} for name, errors in nodes.items()],
        }

    def _is_ours(self, key: tuple[int, bool]) -> bool:
        return not key[1] and key[0] in self._names

    def _row(
        self, key: tuple[int, bool], row: _Row, receivers: Mapping[int, ReceiverState], now_ns: int
    ) -> LiveMessage:
        frame_id, ours = key[0], self._is_ours(key)
        state = receivers[frame_id] if ours else None
        seconds = len(row.lately) * self._period_ns / _NS
        return {
            "id": frame_id,
            "name": self._names[frame_id] if ours else "unknown",
            "sender": row.sender,
            "count": row.count,
            "rate_hz": sum(row.lately) / seconds if seconds else None,
            "age_ms": (now_ns - row.last_ns) / 1e6,
            "e2e": "" if state is None else (state.window[-1] if state.window else FrameCheck.NO_NEW_DATA).name,
            "e2e_state": "" if state is None else state.stream.name,  # NODATA, INIT, VALID or INVALID
            "errors": 0 if state is None else sum(state.counts) - sum(map(state.count, GOOD)),
            "limit_ms": self._period_ns / 1e6 if ours else None,  # cycle time in the DBC
        }
