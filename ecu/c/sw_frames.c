/* The two frames of a control period, built from the ECU's decision and its counters. */
#include "sw_counts.h"
#include "sw_ecu_parts.h"

static void start_frame(sw_frame *frame, uint32_t id, int length, int64_t now_ns)
{
    frame->timestamp_ns = now_ns < 0 ? 0 : now_ns; /* a time before 0 means a wrong clock */
    frame->id = id;
    frame->is_extended = 0;
    frame->is_fd = SW_FRAMES_FD;
    frame->length = (uint8_t)length;
    for (int i = 0; i < SW_FRAME_BYTES; i++) frame->data[i] = 0;
}

static void write_command(sw_frame *frame, const sw_ecu_state *state, const sw_jet_command *command, int64_t now_ns)
{
    start_frame(frame, SW_COMMAND_ID, SW_COMMAND_BYTES, now_ns);
    sw_emit_command(frame->data, command);
    sw_e2e_protect(frame->data, SW_COMMAND_BYTES, SW_COMMAND_DATA_ID, state->command_counter);
}

static void write_status(sw_frame *frame, const sw_ecu_state *state, uint32_t bundle_hash, int64_t now_ns)
{
    const uint32_t *counts = state->pressures.counts;
    sw_ecu_status status = {0};
    status.state = sw_mode_on_wire(state->fail_safe.mode);
    status.reason = state->fail_safe.reason;
    status.set_aside = (uint8_t)(state->sensors.set_aside >= 0 ? 1 << state->sensors.set_aside : 0);
    status.bundle_hash = bundle_hash;
    status.overruns = state->overruns;
    status.missed = state->missed;
    status.crc_errors = counts[SW_CHECK_ERROR];
    status.refused = sw_counted(counts[SW_CHECK_REPEATED], counts[SW_CHECK_WRONG_SEQUENCE]);
#if SW_SECOC
    status.not_authentic =
        sw_counted(state->pressures.verifier.not_authentic, state->pressures.verifier.not_fresh);
#endif
    status.bus_off = state->health.bus_off;
    status.tx_errors = state->health.tx_errors;
    status.rx_errors = state->health.rx_errors;
    start_frame(frame, SW_STATUS_ID, SW_STATUS_BYTES, now_ns);
    sw_emit_status(frame->data, &status);
    sw_e2e_protect(frame->data, SW_STATUS_BYTES, SW_STATUS_DATA_ID, state->status_counter);
}

#if SW_SECOC
static void secure(sw_frame *frame, const sw_ecu_state *state, const sw_secoc *secoc, int length, uint16_t data_id)
{
    frame->length = (uint8_t)length;
    sw_secoc_secure(secoc, frame->data, (uint32_t)length, data_id, &state->freshness);
}
#endif

int sw_write_frames(sw_ecu_state *state, const sw_jet_command *command, uint32_t bundle_hash, int64_t now_ns,
                    sw_frame frames_out[SW_FRAMES_OUT] SW_BY_KEY(const sw_secoc *secoc))
{
#if SW_SECOC
    if (!secoc->is_given) return 0;
#endif
    write_command(&frames_out[0], state, command, now_ns);
    write_status(&frames_out[1], state, bundle_hash, now_ns);
#if SW_SECOC
    secure(&frames_out[0], state, secoc, SW_COMMAND_SECURED, SW_COMMAND_DATA_ID);
    secure(&frames_out[1], state, secoc, SW_STATUS_SECURED, SW_STATUS_DATA_ID);
    sw_freshness_next(&state->freshness);
#endif
    state->command_counter = (uint8_t)((state->command_counter + 1u) % SW_E2E_COUNTERS);
    state->status_counter = (uint8_t)((state->status_counter + 1u) % SW_E2E_COUNTERS);
    return SW_FRAMES_OUT;
}
