/* The control step on a bare Cortex-M7. For each row, a test bench or a bus driver writes mcu_row and calls mcu_push.
 * From the row that fills the window on, it calls mcu_step instead, and reads mcu_output.
 */
#include <stddef.h>

#include "stillwake.h"

void *memcpy(void *restrict to, const void *restrict from, size_t count);
void mcu_reset(void);
int mcu_push(void);
int mcu_step(void);
int mcu_longest_step(void);

float mcu_row[SW_COLUMNS]; /* pressures Cp, and the action of the previous step */
sw_input mcu_input;
sw_output mcu_output;
static sw_workspace workspace;

extern unsigned char mcu_hot_start[], mcu_hot_end[], mcu_hot_load[];

/* Copies to data TCM the constants that every step reads, then resets the input. */
void mcu_reset(void)
{
    memcpy(mcu_hot_start, mcu_hot_load, (size_t)(mcu_hot_end - mcu_hot_start));
    (void)sw_input_reset(&mcu_input); /* the status is not needed: every step checks the arithmetic */
}

int mcu_push(void)
{
    sw_input_push(&mcu_input, mcu_row, mcu_row[SW_SENSORS]);
    return 0;
}

int mcu_step(void)
{
    mcu_push();
    const sw_status status = sw_control_step(&workspace, &mcu_input, &mcu_output);
    for (int k = 0; k < SW_HORIZON; k++) mcu_input.plan[k] = mcu_output.plan[k];
    return (int)status;
}

/* Runs a step with a weight for which the prior cannot be used, so that all iterations run. */
int mcu_longest_step(void)
{
    mcu_input.weights[SW_RATE] += 1e-6f;
    return mcu_step();
}
