"""To be replaced by can_bridge.flashing.report."""

import json

from can_bridge.flashing.backing import Slot
from can_bridge.flashing.store import Store


def report(store: Store) -> bytes:
    """The JSON."""
    state = store.state
    slots = {
        slot.name: {
            "phase": state.slots[slot].phase.name,
            "name": state.slots[slot].name,
            "digest": state.slots[slot].digest,
            "security_version": state.slots[slot].security_version,
            "received": state.slots[slot].received,
            "length": state.slots[slot].length,
            "boots_left": state.slots[slot].boots_left,
        }
        for slot in Slot
    }
    body = {
        "slots": slots,
        "running": None if store.running is None else store.running.name,
        "least_security_version": state.least_security_version,
        "key_list_version": store.keys.version if store.keys else 0,
    }
    return json.dumps(body).encode()
