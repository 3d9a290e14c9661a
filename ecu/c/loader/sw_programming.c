/* The programming through UDS: key lists, routines and downloads that use the store. */
#include "sw_programming.h"

#include <float.h>
#include <stddef.h>

#include "sw_ecu_parts.h"

int sw_programming_has_release(const sw_programming *programming)
{
    return programming->ecu->numbers.release != NULL && programming->store->running != SW_NO_SLOT;
}

uint8_t sw_programming_before_reset(const sw_programming *programming)
{
    return programming->is_updating ? 0u : sw_request_refusal(programming->request);
}

uint8_t sw_programming_take_keys(sw_programming *programming, const uint8_t *value, uint32_t length)
{
    uint8_t digest[SW_SHA256_BYTES];
    sw_sha256_of(value, length, digest);
    const int is_again = programming->has_keys && sw_bytes_equal(digest, programming->keys_digest, sizeof digest);
    if (is_again) return SW_UDS_DONE;
    /* Verifying a signature takes several milliseconds, so a key list is refused while control is requested. */
    uint8_t code = sw_request_refusal(programming->request);
    if (code == 0u) code = sw_store_refusal(sw_store_take_keys(programming->store, value, length));
    if (code == SW_UDS_DONE) {
        programming->has_keys = 1;
        sw_bytes_copy(programming->keys_digest, digest, sizeof digest);
    }
    return code;
}

uint8_t sw_programming_download(const sw_programming *programming, uint32_t offset, uint32_t length)
{
    const sw_store *store = programming->store;
    if (store->announced == SW_NO_SLOT) return SW_NRC_SEQUENCE_ERROR;
    const sw_slot_state *slot = &store->state.slots[store->announced];
    const int is_missing = offset == slot->received && length == slot->length - slot->received;
    return is_missing ? 0u : SW_NRC_OUT_OF_RANGE;
}

/* --- Like ecu/flashable/vehicle_fit.py, the self-test checks whether the running release computes correctly on this
 * chip. The test may overwrite the memory of the control step, because later periods do not need its content. ---
 */

#define AMPLITUDE 0.3f /* in Cp: a typical amplitude of a shedding wake at the rear edges */
/* Sine, and twice the cosine, of 2 pi / 25: a shedding cycle takes 25 periods. */
#define SINE 0.2486898872f
#define TWICE_COSINE 1.9371663222f
#define SLACK 1e-5f /* float32 rounding may let an action exceed the limit by this amount */

/* Fills the window with pressures of a shedding wake, with opposite signs at neighbouring sensors. */
static void fill(sw_input *input, float amplitude)
{
    float now = 0.0f;
    float next = amplitude * SINE;
    for (int k = 0; k < SW_WINDOW; k++) {
        for (int s = 0; s < SW_SENSORS; s++) input->window[k][s] = s % 2 == 0 ? now : -now;
        input->window[k][SW_SENSORS] = 0.0f;
        const float after = TWICE_COSINE * next - now;
        now = next;
        next = after;
    }
    for (int k = 0; k < SW_HORIZON; k++) {
        input->plan[k] = 0.0f;
        input->free[k] = 1.0f;
    }
}

static int is_within(float value, float most) { return value >= -most && value <= most; }

static int runs(sw_ecu *ecu, float amplitude, float most)
{
    sw_output *output = &ecu->output;
    fill(&ecu->input, amplitude);
    for (int i = 0; i < SW_TERMS; i++) ecu->input.weights[i] = ecu->numbers.release->weights[i];
    ecu->input.speed = 1.0f;
    ecu->input.limit = FLT_MAX; /* no limit: the plan is compared with the release's own limit */
    ecu->trace.planned = 0;
    int sound = sw_control_step_of(&ecu->numbers.program, &ecu->work.control, &ecu->input, output) == SW_OK;
    for (int k = 0; k < SW_HORIZON; k++) {
        sound &= is_within(output->plan[k], most + SLACK);
        sound &= is_within(output->forces[k][0], FLT_MAX) & is_within(output->forces[k][1], FLT_MAX);
    }
    return sound;
}

/* Runs one part of the self-test: a control step on a window must lead to a finite plan within the action limit. */
static uint8_t test_piece(sw_programming *programming)
{
    programming->has_passed = 0;
    if (!sw_programming_has_release(programming)) return SW_NRC_CONDITIONS_NOT_CORRECT;
    programming->piece++;
    if (programming->piece == 1u) return SW_UDS_MORE;
    if (programming->piece <= 3u) {
        sw_calibration own;
        sw_calibration_own(programming->ecu->numbers.release, &own);
        const float amplitude = programming->piece == 2u ? 0.0f : AMPLITUDE;
        return runs(programming->ecu, amplitude, own.action_limit) ? SW_UDS_MORE : SW_NRC_PROGRAMMING_FAILURE;
    }
    programming->has_passed = 1;
    return SW_UDS_DONE;
}

/* --- Routines: long work of the store begins here and continues in sw_programming_go_on --- */

/* Writes the store's result to the answer: the offset of an image's first missing byte, or the verdict of a check. */
static uint8_t ended(const sw_programming *programming, sw_store_result result, sw_answer *answer)
{
    const sw_store *store = programming->store;
    if (result != SW_STORE_DONE) return sw_store_refusal(result);
    if (programming->routine == SW_ROUTINE_ERASE) {
        sw_answer_number(answer, store->wanted, 4);
    } else if (programming->routine == SW_ROUTINE_CHECK) {
        sw_answer_byte(answer, store->verdict);
    } else if (store->verdict != SW_VERDICT_GOOD) {
        return SW_NRC_CONDITIONS_NOT_CORRECT; /* the earlier release failed its check */
    } else {
        /* A revert reports no data. */
    }
    return SW_UDS_DONE;
}

static uint8_t announce(sw_programming *programming, const uint8_t *option, sw_answer *answer)
{
    const uint8_t code = sw_request_refusal(programming->request);
    if (code != 0u) return code;
    programming->is_updating = 1;
    programming->has_passed = 0;
    programming->has_confirmed = 0;
    return ended(programming, sw_store_announce(programming->store, sw_number(option, 4), &option[4]), answer);
}

/* Confirms the running release if it is on trial and has passed its self-test. Acknowledges a repeated request after
 * such a confirmation. Refuses all other requests.
 */
static uint8_t confirm(sw_programming *programming)
{
    const sw_store *store = programming->store;
    uint8_t code = SW_UDS_DONE;
    if (store->running != SW_NO_SLOT && store->state.slots[store->running].phase == SW_PHASE_TRIAL) {
        code = SW_NRC_SEQUENCE_ERROR;
        if (programming->has_passed) code = sw_store_refusal(sw_store_confirm(programming->store));
        if (code == SW_UDS_DONE) programming->has_confirmed = 1;
    } else if (!programming->has_confirmed) {
        code = SW_NRC_SEQUENCE_ERROR;
    } else {
        /* A repeated confirmation is acknowledged. */
    }
    return code;
}

uint8_t sw_programming_begin(sw_programming *programming, uint32_t routine, const uint8_t *option, sw_answer *answer)
{
    uint8_t code = SW_UDS_DONE;
    programming->routine = (uint16_t)routine;
    programming->piece = 0;
    switch (routine) {
    case SW_ROUTINE_PRECONDITIONS:
        code = sw_request_refusal(programming->request);
        break;
    case SW_ROUTINE_ERASE:
        code = announce(programming, option, answer);
        break;
    case SW_ROUTINE_CHECK:
        code = ended(programming, sw_store_finish(programming->store), answer);
        break;
    case SW_ROUTINE_ACTIVATE:
        code = sw_store_refusal(sw_store_activate(programming->store));
        break;
    case SW_ROUTINE_SELF_TEST:
        code = test_piece(programming);
        break;
    case SW_ROUTINE_CONFIRM:
        code = confirm(programming);
        break;
    default: /* SW_ROUTINE_REVERT, the only remaining routine in the table of routines */
        code = sw_request_refusal(programming->request);
        if (code == 0u) code = ended(programming, sw_store_revert(programming->store), answer);
        break;
    }
    return code;
}

uint8_t sw_programming_go_on(sw_programming *programming, sw_answer *answer)
{
    if (programming->routine == SW_ROUTINE_SELF_TEST) return test_piece(programming);
    return ended(programming, sw_store_go_on(programming->store), answer);
}
