/* The receiver of a protected message (PRS_E2EProtocol: first the profile check, then the state machine).
 *
 * Each frame gets a result (sw_check) from its CRC and counter. A period's result is the result of its frames that has
 * the highest priority. The results of the latest periods decide whether the stream is trusted.
 */
#include "sw_ecu_parts.h"

/* Returns whether a frame has the message's 11-bit identifier; an equal 29-bit identifier belongs to another node. */
static int is_of(const sw_message *message, const sw_frame *frame)
{
    return frame->id == message->id && !frame->is_extended;
}

/* Checks a frame, and updates the receiver's counter. */
static sw_check checked(sw_receiver *receiver, const sw_message *message, const sw_frame *frame)
{
#if !SW_SECOC
    if ((int)frame->length != message->bytes) return SW_CHECK_ERROR;
#endif
    if (!sw_e2e_check(frame->data, message->bytes, message->data_id)) return SW_CHECK_ERROR;
    const uint32_t counter = sw_e2e_counter(frame->data);
    const uint32_t steps = (counter + (uint32_t)SW_E2E_COUNTERS - receiver->last_counter) % (uint32_t)SW_E2E_COUNTERS;
    /* The first frame cannot be compared with an earlier frame. */
    const uint32_t delta = receiver->has_counter ? steps : 1u;
    receiver->has_counter = 1;
    receiver->last_counter = (uint8_t)counter;
    if (delta == 0u) return SW_CHECK_REPEATED;
    if (delta == 1u) return SW_CHECK_OK;
    return delta <= (uint32_t)SW_E2E_MAX_DELTA ? SW_CHECK_OK_SOME_LOST : SW_CHECK_WRONG_SEQUENCE;
}

/* Returns a period's result: the first result in `order` that a frame has; `found` has a bit for each result. */
static sw_check of_period(uint32_t found)
{
    static const sw_check order[] = {SW_CHECK_ERROR, SW_CHECK_OK, SW_CHECK_OK_SOME_LOST, SW_CHECK_WRONG_SEQUENCE,
                                     SW_CHECK_REPEATED};
    for (int i = 0; i < (int)(sizeof order / sizeof order[0]); i++) {
        if ((found >> order[i]) & 1u) return order[i];
    }
    return SW_CHECK_NO_NEW_DATA;
}

static void counted(sw_receiver *receiver, sw_check check)
{
    if (receiver->counts[check] < UINT32_MAX) receiver->counts[check]++;
}

/* Adds a period's result to the window. */
static void remember(sw_receiver *receiver, sw_check period)
{
    if (receiver->checks == SW_E2E_WINDOW) {
        for (int i = 1; i < SW_E2E_WINDOW; i++) receiver->window[i - 1] = receiver->window[i];
        receiver->checks--;
    }
    receiver->window[receiver->checks] = (uint8_t)period;
    receiver->checks++;
}

static int count_of(const sw_receiver *receiver, sw_check check)
{
    int count = 0;
    for (int i = 0; i < receiver->checks; i++) count += receiver->window[i] == (uint8_t)check;
    return count;
}

/* Updates the stream's state and the window with one period's result. */
static void advance(sw_receiver *receiver, sw_check period)
{
    if (receiver->stream == SW_NODATA) {
        if (period == SW_CHECK_ERROR || period == SW_CHECK_NO_NEW_DATA) return;
        receiver->stream = SW_STREAM_INIT;
        remember(receiver, period);
        return;
    }
    remember(receiver, period);
    const int good = count_of(receiver, SW_CHECK_OK) + count_of(receiver, SW_CHECK_OK_SOME_LOST);
    const int least = receiver->stream == SW_VALID ? 1 : SW_E2E_MIN_OK;
    if (count_of(receiver, SW_CHECK_ERROR) > SW_E2E_MAX_ERRORS) {
        receiver->stream = SW_INVALID;
    } else if (good >= least) {
        receiver->stream = SW_VALID;
    } else if (receiver->stream == SW_VALID) {
        receiver->stream = SW_INVALID;
    } else {
        /* INIT and INVALID do not change. */
    }
}

const sw_frame *sw_receive(sw_receiver *receiver, const sw_message *message, const sw_frame *frames,
                           int count SW_BY_KEY(const sw_secoc *secoc))
{
    const sw_frame *accepted = NULL;
    uint32_t found = 0;
    for (int i = 0; i < count; i++) {
        if (!is_of(message, &frames[i])) continue;
#if SW_SECOC
        if (!sw_secoc_accepts(&receiver->verifier, secoc, frames[i].data, frames[i].length, (uint32_t)message->secured,
                              message->data_id)) {
            continue;
        }
#endif
        const sw_check check = checked(receiver, message, &frames[i]);
        counted(receiver, check);
        found |= 1u << check;
        if (check == SW_CHECK_OK || check == SW_CHECK_OK_SOME_LOST) accepted = &frames[i];
    }
    if (found == 0u) counted(receiver, SW_CHECK_NO_NEW_DATA);
    advance(receiver, of_period(found));
    return accepted;
}
