/* One period of the fail-safe, with its state and inputs as plain numbers. */
#include "sw_ecu_parts.h"

void fail_safe_step(const uint64_t before[6], const uint8_t given[9], int latch, uint64_t after[6]);

void fail_safe_step(const uint64_t before[6], const uint8_t given[9], int latch, uint64_t after[6])
{
    const sw_period_inputs inputs = {given[0], given[1], given[2], given[3], given[4], given[5], given[6], given[7], given[8]};
    sw_fail_safe state = {(uint8_t)before[0], (uint8_t)before[1], (uint8_t)before[2], (uint32_t)before[3],
                          (uint32_t)before[4], before[5]};
    sw_fail_safe_next(&state, &inputs);
    if (latch != 0) sw_fail_safe_latch(&state, (uint8_t)latch);
    after[0] = state.mode;
    after[1] = state.reason;
    after[2] = state.enable_request;
    after[3] = state.misses;
    after[4] = state.good;
    after[5] = state.lost;
}
