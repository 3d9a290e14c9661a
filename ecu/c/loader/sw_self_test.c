/* Whether the release that runs computes on this very chip. The twin of ecu/flashable/vehicle_fit.py.
 *
 * It uses the ECU's own memory for the control step: nothing of it is read in a later period.
 */
#include <float.h>

#include "sw_ecu_parts.h"
#include "sw_node.h"

#define AMPLITUDE 0.3f /* in Cp: what a shedding wake brings at the rear edges */
/* Of an angle of 2 pi in 25 periods, a shedding cycle. */
#define SINE 0.2486898872f
#define TWICE_COSINE 1.9371663222f
#define SLACK 1e-5f /* by which a plan in float32 may exceed the action limit */

/* Pressures of a shedding wake, opposite ones at sensors next to each other; or zeros. */
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
    ecu->input.limit = FLT_MAX; /* the program's own is looked at */
    ecu->trace.planned = 0;
    int sound = sw_control_step_of(&ecu->numbers.program, &ecu->work.control, &ecu->input, output) == SW_OK;
    for (int k = 0; k < SW_HORIZON; k++) {
        sound &= is_within(output->plan[k], most + SLACK);
        sound &= is_within(output->forces[k][0], FLT_MAX) & is_within(output->forces[k][1], FLT_MAX);
    }
    return sound;
}

uint8_t sw_self_test(sw_node *node, sw_answer *answer)
{
    sw_uds *uds = &node->uds;
    node->programming.has_passed = 0;
    if (!sw_node_has_release(node)) return SW_NRC_CONDITIONS_NOT_CORRECT;
    uds->work = sw_self_test;
    uds->piece++;
    switch (uds->piece) {
    case 1:
        return SW_UDS_MORE;
    case 2:
        return runs(&node->ecu, 0.0f, node->calibrating.release.action_limit) ? SW_UDS_MORE : SW_NRC_PROGRAMMING_FAILURE;
    case 3:
        return runs(&node->ecu, AMPLITUDE, node->calibrating.release.action_limit) ? SW_UDS_MORE : SW_NRC_PROGRAMMING_FAILURE;
    default:
        sw_answer_bytes(answer, uds->head, sizeof uds->head);
        node->programming.has_passed = 1;
        return SW_UDS_DONE;
    }
}
