/* Functions for counts that saturate at their largest value, and a function that counts the bits in a word. */
#ifndef SW_COUNTS_H
#define SW_COUNTS_H

#include <stdint.h>

/* Counts the bits in pairs, then fours, then bytes, so that the time does not depend on the value. */
static inline int sw_bit_count(uint64_t bits)
{
    const uint64_t pairs = bits - ((bits >> 1) & UINT64_C(0x5555555555555555));
    const uint64_t fours = (pairs & UINT64_C(0x3333333333333333)) + ((pairs >> 2) & UINT64_C(0x3333333333333333));
    const uint64_t bytes = (fours + (fours >> 4)) & UINT64_C(0x0f0f0f0f0f0f0f0f);
    return (int)((bytes * UINT64_C(0x0101010101010101)) >> 56);
}

static inline uint32_t sw_counted(uint32_t count, uint64_t more)
{
    return more < (uint64_t)(UINT32_MAX - count) ? count + (uint32_t)more : UINT32_MAX;
}

#endif
