/* Functions that read, write and compare bytes and numbers without a library, and a buffer for an answer. Numbers are
 * big-endian unless a function's name says otherwise.
 */
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

/* Returns the number in `count` bytes, where `count` is at most 4. */
static inline uint32_t sw_number(const uint8_t *bytes, uint32_t count)
{
    uint32_t value = 0;
    for (uint32_t i = 0; i < count; i++) value = value << 8 | bytes[i];
    return value;
}

static inline uint32_t sw_big_u32(const uint8_t *data) { return sw_number(data, 4); }

static inline void sw_put_big_u32(uint8_t *to, uint32_t value)
{
    for (uint32_t i = 0; i < 4u; i++) to[i] = (uint8_t)(value >> (24u - 8u * i));
}

static inline uint32_t sw_little_u32(const uint8_t *data)
{
    return data[0] | (uint32_t)data[1] << 8 | (uint32_t)data[2] << 16 | (uint32_t)data[3] << 24;
}

/* An answer that is being written. Bytes that exceed `room` are counted in `length`, but not stored. */
typedef struct {
    uint8_t *bytes;
    uint32_t room;
    uint32_t length;
} sw_answer;

static inline void sw_answer_byte(sw_answer *answer, uint32_t byte)
{
    if (answer->length < answer->room) answer->bytes[answer->length] = (uint8_t)(byte & 0xffu);
    answer->length++;
}

static inline void sw_answer_bytes(sw_answer *answer, const uint8_t *bytes, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) sw_answer_byte(answer, bytes[i]);
}

/* Appends the lowest `count` bytes of a number. */
static inline void sw_answer_number(sw_answer *answer, uint64_t value, uint32_t count)
{
    for (uint32_t i = count; i > 0u; i--) sw_answer_byte(answer, (uint32_t)(value >> (8u * (i - 1u)) & 0xffu));
}

static inline void sw_answer_little_u32(sw_answer *answer, uint32_t value)
{
    for (uint32_t i = 0; i < 4u; i++) sw_answer_byte(answer, value >> (8u * i) & 0xffu);
}

static inline void sw_answer_text(sw_answer *answer, const char *text)
{
    for (uint32_t i = 0; text[i] != '\0'; i++) sw_answer_byte(answer, (uint8_t)text[i]);
}

#endif
