/* Turns a control period's frames into pressures that may be planned on, or says why there are none. In this order: the
 * end-to-end check, the age, the sensors' own diagnosis. And whether another ECU is on the bus.
 */
#include "sw_counts.h"
#include "sw_ecu_parts.h"

#define ALL_VALID ((1u << SW_SENSORS) - 1u)

/* A frame that waited in a queue, or was late before it was sent, is as old as it is. No frame is of a time before 0; the
 * order of comparisons keeps the differences within 64 bits.
 */
int sw_is_fresh(int64_t timestamp_ns, int64_t age_ns, int64_t now_ns, int64_t oldest_ns)
{
    if (timestamp_ns < 0) return 0;
    const int64_t sampled_ns = timestamp_ns - age_ns;
    return sampled_ns <= now_ns && sampled_ns >= now_ns - oldest_ns;
}

void sw_reception(sw_received *received, sw_receiver *receiver, const sw_frame *frames, int count, int64_t now_ns,
                  double dynamic_pressure)
{
    static const sw_message message = {SW_PRESSURE_ID, SW_PRESSURE_BYTES, SW_PRESSURE_DATA_ID};
    sw_pressure pressure;
    const sw_frame *frame = sw_receive(receiver, &message, frames, count);
    received->usable = 0;
    received->has_request = 0;
    received->enable_request = 0;
    received->unusable_because =
        (uint8_t)(receiver->stream == SW_INVALID ? SW_REASON_STREAM_INVALID : SW_REASON_STREAM_LOST);
    received->counter = 0;
    received->sampled_ns = 0;
    for (int i = 0; i < SW_SENSORS; i++) received->cp[i] = 0.0;
    if (frame == NULL) return;
    sw_parse_pressure(frame->data, &pressure);
    if (receiver->stream != SW_VALID) {
        /* Control is requested by a stream that is trusted alone; its end is believed of any good frame. */
        received->has_request = (uint8_t)!pressure.enable_request;
        return;
    }
    received->has_request = 1;
    received->enable_request = pressure.enable_request;
    if (!sw_is_fresh(frame->timestamp_ns, pressure.age_ns, now_ns, SW_FRESH_AGE_NS)) {
        received->unusable_because = SW_REASON_STALE;
    } else if (pressure.valid != ALL_VALID) {
        received->unusable_because = SW_REASON_SENSOR_INVALID;
#if SW_PAST > 0
    } else if (dynamic_pressure <= 0.0) {
        received->unusable_because = SW_REASON_NO_SPEED;
#endif
    } else {
        received->usable = 1;
        received->unusable_because = SW_REASON_NONE;
        received->counter = sw_e2e_counter(frame->data);
        received->sampled_ns = frame->timestamp_ns - pressure.age_ns;
        for (int i = 0; i < SW_SENSORS; i++) {
            received->cp[i] = pressure.pressure_pa[i] / dynamic_pressure;
#if SW_PAST > 0
            received->reading[i] = pressure.pressure_pa[i] / SW_DYNAMIC_PRESSURE;
#endif
        }
    }
}

/* Whether it is a sound message of at most so many bytes. */
static int is_sound(const sw_frame *frame, int bytes, uint16_t data_id)
{
    return sw_e2e_check(frame->data, frame->length < bytes ? frame->length : bytes, data_id);
}

/* A node does not hear its own frames. */
static uint32_t heard_of_other(const sw_frame *frames, int count)
{
    uint32_t heard = 0;
    for (int i = 0; i < count; i++) {
        if (frames[i].is_extended) continue;
        if (frames[i].id == SW_COMMAND_ID && is_sound(&frames[i], SW_COMMAND_BYTES, SW_COMMAND_DATA_ID)) heard++;
        if (frames[i].id == SW_STATUS_ID && is_sound(&frames[i], SW_STATUS_BYTES, SW_STATUS_DATA_ID)) heard++;
    }
    return heard;
}

/* Both ECUs keep the jets shut until the other one has been silent for a while. */
void sw_other_ecu_next(sw_other_ecu *other, const sw_frame *frames, int count, int64_t step_ns)
{
    const uint32_t heard = heard_of_other(frames, count);
    other->frames = sw_counted(other->frames, heard);
    if (heard > 0u) {
        other->is_there = 1;
        other->until_ns = step_ns + SW_SILENCE_NS;
    } else if (step_ns > other->until_ns) {
        other->is_there = 0;
        other->until_ns = 0;
    } else {
        /* It may only have lost the bus. */
    }
}
