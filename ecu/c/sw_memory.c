/* The memory of the controller from one period to the next: window, plan and actions in transit.
 *
 * The window's row at period k is (Cp_k, a_{k-1}): the present pressures, and the action in force when they were
 * sampled. In a release for a range of speeds the window is resampled from a record of past periods. Pressures, actions
 * and plan are then made dimensionless with the present speed, sent actions and actions in transit with the design
 * speed. This file corresponds to ecu/controller_memory.py.
 */
#include "sw_ecu_parts.h"

/* Largest number of periods without pressures that the window may bridge. */
#define LONGEST_GAP (SW_HOLD_PERIODS + SW_DECAY_PERIODS)

/* Number of rows whose actions a longer delay can bring back into transit: the delay is shorter than the horizon. */
#if SW_PAST > SW_HORIZON
#define ACTED SW_HORIZON
#else
#define ACTED SW_KEPT
#endif

/* Limits an index to 0 .. last. */
static int clipped(int index, int last)
{
    if (index < 0) return 0;
    return index > last ? last : index;
}

static void extended(sw_memory *memory, const double cp[SW_SENSORS], double speed)
{
    double row[SW_COLUMNS]; /* a copy, since cp may be a row of the window */
    for (int s = 0; s < SW_SENSORS; s++) row[s] = cp[s];
    row[SW_SENSORS] = memory->under_way[0] / speed;
#if SW_PAST > 0
    sw_past_extend(&memory->past, row, speed);
    memory->rows = sw_past_read(&memory->past, memory->window, 0, SW_SENSORS);
#else
    for (int k = 0; k + 1 < SW_WINDOW; k++) {
        for (int c = 0; c < SW_COLUMNS; c++) memory->window[k][c] = memory->window[k + 1][c];
    }
    for (int c = 0; c < SW_COLUMNS; c++) memory->window[SW_WINDOW - 1][c] = row[c];
    if (memory->rows < SW_WINDOW) memory->rows++;
#endif
}

void sw_memory_observed(sw_memory *memory, const double cp[SW_SENSORS], double speed)
{
    extended(memory, cp, speed);
    memory->gap = 0;
}

void sw_memory_bridged(sw_memory *memory)
{
    if (memory->gap <= LONGEST_GAP) memory->gap++;
    if (memory->gap > LONGEST_GAP) {
        /* The controller must not plan from outdated pressures. */
        sw_memory_emptied(memory);
    } else if (memory->rows > 0) {
        extended(memory, memory->window[SW_WINDOW - 1], sw_memory_speed(memory));
    } else {
        /* No row can be repeated, because there is none yet. */
    }
}

void sw_memory_emptied(sw_memory *memory)
{
    for (int k = 0; k < SW_WINDOW; k++) {
        for (int c = 0; c < SW_COLUMNS; c++) memory->window[k][c] = 0.0;
    }
    memory->rows = 0;
#if SW_PAST > 0
    sw_past_empty(&memory->past);
#endif
}

double sw_memory_speed(const sw_memory *memory)
{
#if SW_PAST > 0
    return memory->past.count > 0u ? memory->past.speeds[SW_PAST - 1] : 1.0;
#else
    (void)memory;
    return 1.0;
#endif
}

void sw_memory_commanded(sw_memory *memory, double action)
{
    const int frozen = (int)memory->frozen;
    for (int k = 0; k < frozen; k++) memory->under_way[k] = memory->under_way[k + 1];
    memory->under_way[frozen] = action;
}

/* Changes the delay, and so the times at which the sent actions take effect. The latest actions are in transit. Each
 * row of the window gets the action that would have been in force with the new delay, or the oldest row's action if no
 * older action is stored. The plan is shifted so that its action for the next period does not change. In a release for
 * a range of speeds, a changed delay empties the window.
 */
void sw_memory_freeze(sw_memory *memory, int frozen)
{
    double sent[ACTED + SW_HORIZON]; /* actions of the rows, then actions in transit: a series without a gap */
    float plan[SW_HORIZON];
    const int later = frozen - (int)memory->frozen;
    for (int k = 0; k < SW_HORIZON; k++) {
        sent[ACTED + k] = memory->under_way[k];
        plan[k] = memory->plan[k];
    }
#if SW_PAST > 0
    for (int k = 0; k < ACTED; k++) {
        const int row = SW_PAST - ACTED + k;
        sent[k] = memory->past.rows[row][SW_SENSORS] * memory->past.speeds[row];
    }
    if (later != 0) sw_memory_emptied(memory);
#else
    for (int k = 0; k < SW_WINDOW; k++) sent[k] = memory->window[k][SW_SENSORS];
    for (int k = SW_WINDOW - (int)memory->rows; k < SW_WINDOW; k++) {
        memory->window[k][SW_SENSORS] = sent[clipped(k - later, ACTED + SW_HORIZON - 1)];
    }
#endif
    for (int k = 0; k < SW_HORIZON; k++) {
        memory->under_way[k] = k <= frozen ? sent[clipped(ACTED + k - later, ACTED + SW_HORIZON - 1)] : 0.0;
        memory->plan[k] = plan[clipped(k - later, SW_HORIZON - 1)];
    }
    memory->frozen = (uint32_t)frozen;
}

void sw_memory_without_plan(sw_memory *memory)
{
    for (int k = 0; k < SW_HORIZON; k++) memory->plan[k] = 0.0f;
}

void sw_memory_with_column(sw_memory *memory, int sensor, const double values[SW_KEPT][SW_SENSORS])
{
#if SW_PAST > 0
    for (int k = SW_PAST - (int)memory->past.count; k < SW_PAST; k++) memory->past.rows[k][sensor] = values[k][sensor];
    /* If the window has rows, their other columns are already resampled from the past. */
    const int is_new = memory->rows == 0u;
    memory->rows = sw_past_read(&memory->past, memory->window, is_new ? 0 : sensor, is_new ? SW_SENSORS : sensor);
#else
    for (int k = SW_WINDOW - (int)memory->rows; k < SW_WINDOW; k++) memory->window[k][sensor] = values[k][sensor];
#endif
}

void sw_memory_input(const sw_memory *memory, const sw_calibration *calibration, sw_input *input)
{
    const int frozen = (int)memory->frozen;
    const double speed = sw_memory_speed(memory);
    for (int k = 0; k < SW_WINDOW; k++) {
        for (int c = 0; c < SW_COLUMNS; c++) input->window[k][c] = (float)memory->window[k][c];
    }
    for (int k = 0; k < SW_HORIZON; k++) {
        input->plan[k] = memory->plan[k];
        input->free[k] = k < frozen ? 0.0f : 1.0f;
    }
    /* The control step shifts the plan by a step. The plan's first actions are then in transit to a delayed actuator.
     * The sent actions replace them, because they include the effects of the gate, of held commands and of the
     * message's resolution.
     */
    for (int k = 1; k <= frozen; k++) {
        const double sent = memory->under_way[k] / speed;
        input->plan[k] = (float)sent;
    }
    for (int i = 0; i < SW_TERMS; i++) input->weights[i] = calibration->weights[i];
    input->speed = (float)speed;
    input->limit = calibration->action_limit;
}
