/* From frames to pressures that may be planned on, and another ECU on the bus. Whether a CRC fits is free. */
#include "prove.h"

#include "sw_codec_fd.c"
#include "sw_receiver.c"
#include "sw_reception.c"

#define FRAMES 2

int sw_e2e_check(const uint8_t *data, int length, uint16_t data_id)
{
    (void)data_id;
    if (length > 0) (void)(uint8_t)(data[0] | data[length - 1]);
    return length > 0 && nondet_int() != 0;
}

uint8_t sw_e2e_counter(const uint8_t *data) { return data[2]; }

/* The state that a receiver can be in, and stays in. */
static int may_be(const sw_receiver *receiver)
{
    return receiver->stream <= SW_INVALID && receiver->checks <= SW_E2E_WINDOW;
}

void any_stream(void)
{
    static const sw_message message = {SW_PRESSURE_ID, SW_PRESSURE_BYTES, SW_PRESSURE_DATA_ID};
    sw_receiver receiver;
    sw_frame frames[FRAMES];
    const int count = nondet_int();
    ASSUME(may_be(&receiver) && count >= 0 && count <= FRAMES);
    const uint8_t had = receiver.has_counter, last = receiver.last_counter;
    const sw_frame *found = sw_receive(&receiver, &message, frames, count);
    PROVE(may_be(&receiver));
    if (found != NULL) {
        PROVE(found->id == SW_PRESSURE_ID && found->length == SW_PRESSURE_BYTES);
        if (count == 1 && had) PROVE((uint8_t)(sw_e2e_counter(found->data) - last - 1u) < SW_E2E_MAX_DELTA);
    }
}

void any_pressures(void)
{
    sw_received received;
    sw_receiver receiver;
    sw_frame frames[FRAMES];
    const int count = nondet_int();
    const int64_t now_ns = nondet_long();
    const double dynamic_pressure = nondet_double();
    ASSUME(may_be(&receiver) && count >= 0 && count <= FRAMES);
    ASSUME(dynamic_pressure == 0.0 || dynamic_pressure >= 1e-3); /* a greater one, of any speed that is known */
    sw_reception(&received, &receiver, frames, count, now_ns, dynamic_pressure);
    PROVE(may_be(&receiver));
    if (received.usable) {
        PROVE(receiver.stream == SW_VALID && received.has_request);
        PROVE(received.sampled_ns <= now_ns && now_ns - received.sampled_ns <= SW_FRESH_AGE_NS);
        PROVE(dynamic_pressure > 0.0);
    }
    if (received.enable_request) PROVE(receiver.stream == SW_VALID);
}

void another_ecu(void)
{
    sw_other_ecu other;
    sw_frame frames[FRAMES];
    const int count = nondet_int();
    const int64_t step_ns = nondet_long();
    ASSUME(count >= 0 && count <= FRAMES && step_ns >= -1 && step_ns <= SW_LATEST_NS);
    const uint32_t before = other.frames;
    sw_other_ecu_next(&other, frames, count, step_ns);
    if (other.frames != before) PROVE(other.is_there && other.until_ns == step_ns + SW_SILENCE_NS);
}
