/* What both codecs are made of: little-endian words, and numbers that stay at their limit. */
#ifndef SW_CODEC_BYTES_H
#define SW_CODEC_BYTES_H

#include "sw_ecu_parts.h"

static inline uint32_t sw_word(const uint8_t *data) { return (uint32_t)data[0] | ((uint32_t)data[1] << 8); }

/* The lower 16 bits. */
static inline void sw_put_word(uint8_t *data, uint32_t value)
{
    data[0] = (uint8_t)(value & 0xffu);
    data[1] = (uint8_t)((value >> 8) & 0xffu);
}

/* The value of a two's complement field whose sign is the bit `sign`. */
static inline int32_t sw_signed(uint32_t field, uint32_t sign) { return (int32_t)(field ^ sign) - (int32_t)sign; }

static inline uint32_t sw_at_most(uint32_t value, uint32_t limit) { return value < limit ? value : limit; }

/* Bits without a signal are sent as zero, and so is the header. */
static inline void sw_clear(uint8_t *data, int length)
{
    for (int i = 0; i < length; i++) data[i] = 0;
}

#endif
