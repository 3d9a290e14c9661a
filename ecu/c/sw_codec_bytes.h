/* The parts that both codecs share: little-endian words, and numbers that saturate. */
#ifndef SW_CODEC_BYTES_H
#define SW_CODEC_BYTES_H

#include "sw_ecu_parts.h"

static inline uint32_t sw_word(const uint8_t *data) { return (uint32_t)data[0] | ((uint32_t)data[1] << 8); }

/* Writes the lower 16 bits of a value. */
static inline void sw_put_word(uint8_t *data, uint32_t value)
{
    data[0] = (uint8_t)(value & 0xffu);
    data[1] = (uint8_t)((value >> 8) & 0xffu);
}

/* Returns the value of a two's complement field with the sign bit `sign`. */
static inline int32_t sw_signed(uint32_t field, uint32_t sign) { return (int32_t)(field ^ sign) - (int32_t)sign; }

static inline uint32_t sw_at_most(uint32_t value, uint32_t limit) { return value < limit ? value : limit; }

/* Sets all bytes of a message to 0, so that bits without a signal are sent as 0. */
static inline void sw_clear(uint8_t *data, int length)
{
    for (int i = 0; i < length; i++) data[i] = 0;
}

#endif
