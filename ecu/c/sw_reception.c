/* The usable pressures from a control period's frames, or the reason why there are none. The checks are, in this order:
 * authentication, end-to-end protection, age, the sensors' own diagnosis. The file also detects another ECU.
 */
#include "sw_counts.h"
#include "sw_ecu_parts.h"

#define ALL_VALID ((1u << SW_SENSORS) - 1u)

/* The time since sampling includes the time in queues before and after sending. A frame with a time before 0 is
 * invalid. The order of the comparisons keeps the differences within 64 bits.
 */
int sw_is_fresh(int64_t timestamp_ns, int64_t age_ns, int64_t now_ns, int64_t oldest_ns)
{
    if (timestamp_ns < 0) return 0;
    const int64_t sampled_ns = timestamp_ns - age_ns;
    return sampled_ns <= now_ns && sampled_ns >= now_ns - oldest_ns;
}

#if SW_SECOC
/* Returns whether a pressure frame arrived. If so, and the freshness value did not change, no frame was authentic. */
static int came(const sw_frame *frames, int count)
{
    int any = 0;
    for (int i = 0; i < count; i++) {
        if (frames[i].id == (uint32_t)SW_PRESSURE_ID && !frames[i].is_extended) any = 1;
    }
    return any;
}
#endif

void sw_reception(sw_received *received, sw_receiver *receiver, const sw_frame *frames, int count, int64_t now_ns,
                  double dynamic_pressure SW_BY_KEY(const sw_secoc *secoc))
{
#if SW_SECOC
    static const sw_message message = {SW_PRESSURE_ID, SW_PRESSURE_BYTES, SW_PRESSURE_DATA_ID, SW_PRESSURE_SECURED};
    const uint64_t before = receiver->verifier.freshness;
#else
    static const sw_message message = {SW_PRESSURE_ID, SW_PRESSURE_BYTES, SW_PRESSURE_DATA_ID};
#endif
    sw_pressure pressure;
    const sw_frame *frame = sw_receive(receiver, &message, frames, count SW_BY_KEY(secoc));
    received->usable = 0;
    received->has_request = 0;
    received->enable_request = 0;
    received->unusable_because =
        (uint8_t)(receiver->stream == SW_INVALID ? SW_REASON_STREAM_INVALID : SW_REASON_STREAM_LOST);
#if SW_SECOC
    if (receiver->verifier.freshness == before && came(frames, count)) {
        received->unusable_because = SW_REASON_NOT_AUTHENTIC;
    }
#endif
    received->counter = 0;
    received->sampled_ns = 0;
    for (int i = 0; i < SW_SENSORS; i++) received->cp[i] = 0.0;
    if (frame == NULL) return;
    sw_parse_pressure(frame->data, &pressure);
    if (receiver->stream != SW_VALID) {
        /* Only a trusted stream can request control. Any frame with a good check can withdraw the request. */
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

/* Returns whether the first `bytes` bytes of a frame are a message with a valid CRC. */
static int is_sound(const sw_frame *frame, int bytes, uint16_t data_id)
{
    return sw_e2e_check(frame->data, frame->length < bytes ? frame->length : bytes, data_id);
}

#if SW_SECOC
/* Returns whether a frame is authentic. A recorded frame that is sent again is authentic, too. */
static int is_authentic(const sw_secoc *secoc, const sw_frame *frame)
{
    const int is_command = frame->id == SW_COMMAND_ID;
    uint64_t freshness;
    return sw_secoc_is_authentic(secoc, frame->data, frame->length,
                                 is_command ? (uint32_t)SW_COMMAND_SECURED : (uint32_t)SW_STATUS_SECURED,
                                 is_command ? SW_COMMAND_DATA_ID : SW_STATUS_DATA_ID, &freshness);
}
#endif

/* Counts the frames of another ECU; a node does not receive its own frames. */
static uint32_t heard_of_other(const sw_frame *frames, int count SW_BY_KEY(const sw_secoc *secoc))
{
    uint32_t heard = 0;
    for (int i = 0; i < count; i++) {
        if (frames[i].is_extended) continue;
#if SW_SECOC
        if (frames[i].id != SW_COMMAND_ID && frames[i].id != SW_STATUS_ID) continue;
        if (!is_authentic(secoc, &frames[i])) continue;
#endif
        if (frames[i].id == SW_COMMAND_ID && is_sound(&frames[i], SW_COMMAND_BYTES, SW_COMMAND_DATA_ID)) heard++;
        if (frames[i].id == SW_STATUS_ID && is_sound(&frames[i], SW_STATUS_BYTES, SW_STATUS_DATA_ID)) heard++;
    }
    return heard;
}

/* Each of the two ECUs keeps the jets shut until the other one has been silent for SW_SILENCE_NS. */
void sw_other_ecu_next(sw_other_ecu *other, const sw_frame *frames, int count,
                       int64_t step_ns SW_BY_KEY(const sw_secoc *secoc))
{
    const uint32_t heard = heard_of_other(frames, count SW_BY_KEY(secoc));
    other->frames = sw_counted(other->frames, heard);
    if (heard > 0u) {
        other->is_there = 1;
        other->until_ns = step_ns + SW_SILENCE_NS;
    } else if (step_ns > other->until_ns) {
        other->is_there = 0;
        other->until_ns = 0;
    } else {
        /* The other ECU still counts as present: it may only have lost its connection to the bus. If the clock went
         * back, the required time of silence begins now.
         */
        if (other->until_ns > step_ns + SW_SILENCE_NS) other->until_ns = step_ns + SW_SILENCE_NS;
    }
}
