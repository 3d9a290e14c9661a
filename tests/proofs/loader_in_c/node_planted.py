"""Faults that are planted in diagnosis in C, one at a time: the comparison has to notice every one."""

from itertools import count
from pathlib import Path
from typing import Final

from tests.proofs.ecu_in_c.planted import changed
from tests.proofs.loader_in_c.node_library import QUICK, Library, build, sources
from tests.proofs.loader_in_c.node_plans import confirmations
from tests.proofs.loader_in_c.node_program import play, play_plan
from tests.proofs.loader_in_c.node_twin import CONFIGS, world

MOST_SEEDS: Final = 150
PLANTED: Final = (
    ("sw_services.c", "if (counter != transfer->expected) return SW_NRC_WRONG_BLOCK_COUNTER;", ""),
    ("sw_access.c", "if (access->asked != level) return SW_NRC_SEQUENCE_ERROR;\n    access->asked = 0;", ""),
    ("sw_uds.c", "uds->now_ns + FIRST_PENDING_NS;", "uds->now_ns + NEXT_PENDING_NS;"),
    ("sw_services.c", "if (uds->session != SW_SESSION_DEFAULT) {", "if (0) {"),
    ("sw_uds.c", "sw_access_lock(&uds->access);", ""),
    ("sw_uds.c", "sw_isotp_is_receiving(uds->isotp) || ", ""),
    ("sw_uds.c", " || sw_isotp_is_sending(uds->isotp)", ""),
    ("sw_access.c", "if (count < SW_ACCESS_ATTEMPTS)", "if (count <= SW_ACCESS_ATTEMPTS)"),
    ("sw_access.c", "if (access->unlocked == level) return 0;", ""),
    ("sw_isotp.c", "end->next_number = (uint8_t)((end->next_number + 1u) % NUMBERS);", "end->next_number++;"),
    ("sw_isotp.c", "if (end->answer == FLOW_CONTINUE && end->wanted == 0u) end->answer = NO_ANSWER;", ""),
    ("sw_isotp.c", "end->not_before_ns = now_ns + end->separation_ns;", "end->not_before_ns = now_ns;"),
    ("sw_isotp.c", "if (end->left_in_block == 0u) wait_for_flow(end, now_ns);", ""),
    ("sw_uds.c", "if (!uds->is_functional || !is_unsent(code)) send_negative", "send_negative"),
    ("sw_isotp.c", "return frame->data[0] >> 4 == SINGLE ? single_of(frame, message) : 0u;",
     "return single_of(frame, message);"),
    ("sw_services.c", "if (is_last) return SW_UDS_DONE;", ""),
    ("sw_services.c", "transfer->state = SW_TRANSFER_CLOSED;", ""),
    ("sw_services.c", "if (number == SW_ROUTINE_ERASE) services->transfer.state = SW_NO_TRANSFER;", ""),
    ("sw_uds.c", "uds->is_quiet = 0;\n        uds->is_functional", "uds->is_functional"),
    ("sw_programming.c", "if (code == 0u) code = sw_store_refusal(", "code = sw_store_refusal("),
    ("sw_programming.c", "if (code == 0u) code = ended(", "code = ended("),
    ("sw_programming.c", "programming->is_updating = 1;", ""),
    ("sw_programming.c", "programming->has_confirmed = 0;", "programming->has_confirmed = 1;"),
    ("sw_programming.c", "if (programming->has_passed) code = ", "code = "),
    ("sw_programming.c", "has_passed = 0;\n    programming->has_confirmed", "has_confirmed"),
    ("sw_programming.c", "    programming->has_passed = 0;\n    if", "    if"),
    ("sw_programming.c", "if (is_again) return SW_UDS_DONE;", ""),
    ("sw_calibrating.c", "if (calibrating->request->drives_jets) return SW_NRC_CONDITIONS_NOT_CORRECT;", ""),
    ("sw_calibrating.c", "calibrating->working = calibrating->release;\n            ", ""),
    ("sw_node.c", "services->uds.wants_reset ? SW_REASON_UPDATING : SW_REASON_NONE", "SW_REASON_NONE"),
    ("sw_node.c", "if (was_busy || requests == 0u || !sw_uds_is_busy(uds)) sw_uds_tick", "sw_uds_tick"),
    ("sw_programming.c", "is_within(output->plan[k], most + SLACK)", "is_within(output->plan[k], FLT_MAX)"),
    ("sw_node.c", "SW_REASON_NO_RELEASE", "SW_REASON_INTERNAL"),
    ("sw_xcp.c", "if (commands[i].is_protected && !xcp->access.is_unlocked) return SW_XCP_ERROR_ACCESS_LOCKED;", ""),
    ("sw_xcp.c", "if (code == SW_XCP_ERROR_ACCESS_LOCKED) end(xcp);", ""),
    ("sw_calibrating.c", "    calibrating->page = SW_PAGE_WORKING;\n", ""),
    ("sw_daq.c", "measured->mode = mode;", "measured->mode = ecu->state.fail_safe.mode;"),
    ("sw_daq.c", "beside(daq) + bytes > MOST_IN_ODT", "bytes > MOST_IN_ODT"),
    ("sw_xcp_access.c", "    access->has_seed = 1;\n", ""),
    ("sw_xcp_access.c", "if (!sw_bytes_equal(right, access->key, SW_ANSWER_BYTES)) return", "if (0) return"),
    ("sw_xcp_memory.c", "if (memory->page != SW_PAGE_WORKING) return SW_XCP_ERROR_WRITE_PROTECTED;", ""),
    ("sw_xcp_memory.c", "if ((mode & SW_XCP_XCP_MODE) != 0u) memory->page", "memory->page"),
    ("sw_xcp_memory.c", "if (data[4] == SW_PAGE_REFERENCE) return SW_XCP_ERROR_WRITE_PROTECTED;", ""),
    ("sw_xcp_memory.c", "memory->address += count;", ""),
)  # fmt: skip
"""File, text that stands there once, and what stands there instead."""


def noticed(fault: tuple[str, str, str], folder: Path) -> bool:
    """Whether the comparison fails with it; raises ValueError if the sources no longer have the place."""
    for kind, config in CONFIGS.items():
        contents = changed(sources(config), *fault)
        # A library that is loaded stays: each needs a name of its own.
        name = next(name for name in map("{}.so".format, count()) if not (folder / kind / name).exists())
        of = world(kind, Library(contents, build(contents, folder / kind, name, (*QUICK, "-Wno-error"))))
        if play_plan(of, confirmations(of)).differences:
            return True
        for seed in range(MOST_SEEDS):
            if play(of, seed).differences:
                return True
    return False
