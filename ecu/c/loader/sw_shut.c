/* An ECU without a release: it keeps the jets shut and reports why, and can be flashed all the same. The twin of
 * ecu/shut_ecu.py.
 */
#include "sw_counts.h"
#include "sw_ecu_parts.h"
#include "sw_node.h"

static void begin(sw_frame *frame, uint32_t id, int length, int64_t now_ns)
{
    frame->timestamp_ns = now_ns < 0 ? 0 : now_ns;
    frame->id = id;
    frame->is_extended = 0;
    frame->is_fd = SW_FRAMES_FD;
    frame->length = (uint8_t)length;
    for (int i = 0; i < SW_FRAME_BYTES; i++) frame->data[i] = 0;
}

int sw_shut_step(sw_ecu *ecu, uint32_t bundle_hash, int64_t now_ns, sw_frame frames_out[SW_FRAMES_OUT])
{
    sw_ecu_state *state = &ecu->state;
    sw_jet_command command = {0};
    sw_ecu_status status = {0};
    const int updating = ecu->surroundings.updating; /* once it is, until a reset */
    state->fail_safe.mode = updating ? SW_UPDATE : SW_FAULT;
    state->fail_safe.reason = updating ? SW_REASON_UPDATING : SW_REASON_NO_RELEASE;
    state->health = ecu->surroundings.health;
    command.mode = sw_mode_on_wire(state->fail_safe.mode);
    status.state = command.mode;
    status.reason = state->fail_safe.reason;
    status.overruns = state->overruns;
    status.missed = state->missed;
    status.crc_errors = state->pressures.counts[SW_CHECK_ERROR];
    status.refused = sw_counted(state->pressures.counts[SW_CHECK_REPEATED], state->pressures.counts[SW_CHECK_WRONG_SEQUENCE]);
    status.bundle_hash = bundle_hash;
    status.bus_off = state->health.bus_off;
    status.tx_errors = state->health.tx_errors;
    status.rx_errors = state->health.rx_errors;
    begin(&frames_out[0], SW_COMMAND_ID, SW_COMMAND_BYTES, now_ns);
    sw_emit_command(frames_out[0].data, &command);
    sw_e2e_protect(frames_out[0].data, SW_COMMAND_BYTES, SW_COMMAND_DATA_ID, state->command_counter);
    begin(&frames_out[1], SW_STATUS_ID, SW_STATUS_BYTES, now_ns);
    sw_emit_status(frames_out[1].data, &status);
    sw_e2e_protect(frames_out[1].data, SW_STATUS_BYTES, SW_STATUS_DATA_ID, state->status_counter);
    state->command_counter = (uint8_t)((state->command_counter + 1u) % SW_E2E_COUNTERS);
    state->status_counter = (uint8_t)((state->status_counter + 1u) % SW_E2E_COUNTERS);
    return SW_FRAMES_OUT;
}
