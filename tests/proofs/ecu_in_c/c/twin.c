#include "twin.h"

#include <string.h>

/* What the networks answer in this period, and what they were asked. */
static const twin_answers *answers;
static twin_response *asked;

#if SW_SECOC
/* As variants.py has it. */
static const sw_authentication given = {
    {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16}, 7, UINT64_C(0x500000028), UINT64_C(0x500000007)};
#endif

sw_status sw_control_step_of(const sw_program *program, sw_workspace *work, const sw_input *input, sw_output *output)
{
    (void)program;
    (void)work;
    asked->plans_asked++;
    asked->planned_on = *input;
    memset(output, 0, sizeof *output);
    memcpy(output->plan, answers->plan, sizeof output->plan);
    memcpy(output->forces, answers->forces, sizeof output->forces);
    return answers->is_planned ? SW_OK : SW_NOT_FINITE;
}

#if SW_SENSOR_CHECK
void sw_estimate(sw_estimator_work *work, const sw_estimator_weights *weights,
                 const double window[SW_WINDOW][SW_COLUMNS], int first)
{
    (void)weights;
    asked->estimates_asked++;
    /* Before the first row the window is taken to have been like it. */
    for (int k = 0; k < SW_WINDOW; k++) {
        memcpy(asked->estimated_on[k], window[k > first ? k : first], sizeof asked->estimated_on[k]);
    }
    memcpy(work->estimates, answers->estimates, sizeof work->estimates);
}
#endif

sw_status sw_known_answer_of(const sw_program *program, sw_workspace *work, sw_input *input, sw_output *output)
{
    (void)program, (void)work, (void)input, (void)output;
    return SW_OK;
}

uint8_t sw_inexact(void)
{
    return SW_REASON_NONE;
}

size_t sw_workspace_bytes(void)
{
    return sizeof(sw_workspace);
}

void twin_step(sw_ecu *ecu, const twin_stimulus *stimulus, twin_response *response)
{
    sw_frame sent[SW_FRAMES_OUT];
    memset(sent, 0xA5, sizeof sent); /* whatever stood there must not go out */
    memset(response, 0, sizeof *response);
    answers = &stimulus->answers;
    asked = response;
    if (stimulus->restarts) {
        memset(ecu, 0xA5, sizeof *ecu); /* memory at power-on holds anything */
        sw_ecu_init(ecu);
#if SW_SECOC
        (void)sw_ecu_authenticate(ecu, &given);
#endif
        response->starts_otherwise = !stimulus->loads && memcmp(&ecu->state, &stimulus->before, sizeof ecu->state) != 0;
    }
    if (stimulus->loads) (void)sw_ecu_restore(ecu, &stimulus->before); /* one that it refuses differs from Python's */
    if (stimulus->calibrates) response->refused = sw_ecu_calibrate(ecu, &stimulus->calibration);
    response->calibration = ecu->calibration;
    ecu->surroundings = stimulus->surroundings;
    response->sent = sw_ecu_step(ecu, stimulus->now_ns, stimulus->frames, (int)stimulus->count, sent);
    for (int i = 0; i < response->sent && i < SW_FRAMES_OUT; i++) {
        sw_frame *frame = &response->frames[i];
        frame->timestamp_ns = sent[i].timestamp_ns;
        frame->id = sent[i].id;
        frame->is_extended = sent[i].is_extended;
        frame->is_fd = sent[i].is_fd;
        frame->length = sent[i].length;
        if (sent[i].length <= SW_FRAME_BYTES) memcpy(frame->data, sent[i].data, sent[i].length);
    }
    response->trace = ecu->trace;
    response->state = ecu->state;
}

static int is_equal(const uint8_t *one, const uint8_t *other, const uint8_t *compared)
{
    if (memcmp(one, other, sizeof(twin_response)) == 0) return 1;
    for (size_t i = 0; i < sizeof(twin_response); i++) {
        if (compared[i] && one[i] != other[i]) return 0;
    }
    return 1;
}

int twin_run(sw_ecu *ecu, const twin_period *periods, int count, const uint8_t *compared, twin_response *found)
{
    for (int i = 0; i < count; i++) {
        twin_step(ecu, &periods[i].stimulus, found);
        if (!is_equal((const uint8_t *)found, (const uint8_t *)&periods[i].response, compared)) return i;
    }
    return count;
}
