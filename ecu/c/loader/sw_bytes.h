/* Bytes, and numbers in them, where there is no library. */
#ifndef SW_BYTES_H
#define SW_BYTES_H

#include <stdint.h>

static inline int sw_bytes_equal(const uint8_t *one, const uint8_t *other, uint32_t length)
{
    uint32_t different = 0;
    for (uint32_t i = 0; i < length; i++) different |= (uint32_t)one[i] ^ other[i];
    return different == 0u;
}

static inline void sw_bytes_copy(uint8_t *to, const uint8_t *from, uint32_t length)
{
    for (uint32_t i = 0; i < length; i++) to[i] = from[i];
}

static inline void sw_bytes_fill(uint8_t *to, uint8_t value, uint32_t length)
{
    for (uint32_t i = 0; i < length; i++) to[i] = value;
}

static inline uint32_t sw_big_u32(const uint8_t *data)
{
    return ((uint32_t)data[0] << 24) | ((uint32_t)data[1] << 16) | ((uint32_t)data[2] << 8) | (uint32_t)data[3];
}

static inline uint32_t sw_little_u32(const uint8_t *data)
{
    return ((uint32_t)data[3] << 24) | ((uint32_t)data[2] << 16) | ((uint32_t)data[1] << 8) | (uint32_t)data[0];
}

static inline void sw_put_big_u32(uint8_t *to, uint32_t value)
{
    for (uint32_t i = 0; i < 4u; i++) to[i] = (uint8_t)(value >> (24u - 8u * i));
}

/* CRC-32 as zlib has it, of what came before and this; 0 before the first. */
uint32_t sw_crc32(uint32_t before, const uint8_t *data, uint32_t length);

#endif
