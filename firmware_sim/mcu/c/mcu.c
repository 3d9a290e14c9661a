/* The controller on a bare Cortex-M7: start-up, and one call per row of the window. A test bench, or a bus driver,
 * fills mcu_row and reads mcu_output. While the window fills, rows are only pushed.
 */
#include "stillwake.h"

extern unsigned char mcu_hot_start[], mcu_hot_end[], mcu_hot_load[];

void *memcpy(void *restrict to, const void *restrict from, size_t count);
void *memset(void *to, int value, size_t count);
void __aeabi_memclr(void *to, size_t count);
void __aeabi_memclr4(void *to, size_t count);
void __aeabi_memclr8(void *to, size_t count);
void __aeabi_memcpy(void *restrict to, const void *restrict from, size_t count);
void __aeabi_memcpy4(void *restrict to, const void *restrict from, size_t count);
void __aeabi_memcpy8(void *restrict to, const void *restrict from, size_t count);
void mcu_reset(void);
int mcu_push(void);
int mcu_step(void);

float mcu_row[SW_COLUMNS]; /* pressures Cp, and the action that was commanded one step before */
sw_input mcu_input;
sw_output mcu_output;
static sw_workspace workspace;

void *memcpy(void *restrict to, const void *restrict from, size_t count)
{
    unsigned char *target = to;
    const unsigned char *source = from;
    for (size_t i = 0; i < count; i++) target[i] = source[i];
    return to;
}

void *memset(void *to, int value, size_t count)
{
    unsigned char *target = to;
    for (size_t i = 0; i < count; i++) target[i] = (unsigned char)value;
    return to;
}

/* What compilers for this architecture call when they clear or copy; a C library would bring them. */
void __aeabi_memclr(void *to, size_t count) { memset(to, 0, count); }
void __aeabi_memclr4(void *to, size_t count) { memset(to, 0, count); }
void __aeabi_memclr8(void *to, size_t count) { memset(to, 0, count); }
void __aeabi_memcpy(void *restrict to, const void *restrict from, size_t count) { memcpy(to, from, count); }
void __aeabi_memcpy4(void *restrict to, const void *restrict from, size_t count) { memcpy(to, from, count); }
void __aeabi_memcpy8(void *restrict to, const void *restrict from, size_t count) { memcpy(to, from, count); }

void mcu_reset(void)
{
    memcpy(mcu_hot_start, mcu_hot_load, (size_t)(mcu_hot_end - mcu_hot_start));
    sw_input_reset(&mcu_input);
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
