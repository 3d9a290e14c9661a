/* In place of sw_bytes.h: what its loops touch at both ends, without the loops. What lies between two places in an array
 * is in it, too. bytes.c proves that the loops themselves touch nothing else. Whether bytes are equal is free, or, with
 * DIGESTS, said by the first one, which stands for a digest that nobody can forge.
 */
#ifndef SW_BYTES_H
#define SW_BYTES_H

#include "prove.h"

static inline uint8_t touch(const uint8_t *bytes, uint32_t length)
{
    return length > 0u ? (uint8_t)(bytes[0] | bytes[length - 1u]) : (uint8_t)0;
}

static inline int sw_bytes_equal(const uint8_t *one, const uint8_t *other, uint32_t length)
{
    const uint8_t ends = (uint8_t)(touch(one, length) | touch(other, length));
#ifdef DIGESTS
    (void)ends;
    return one[0] == other[0];
#else
    return (ends | 1u) != 0u && nondet_int() != 0;
#endif
}

static inline void sw_bytes_fill(uint8_t *to, uint8_t value, uint32_t length)
{
    if (length == 0u) return;
    to[0] = value;
    to[length - 1u] = value;
}

static inline void sw_bytes_copy(uint8_t *to, const uint8_t *from, uint32_t length)
{
    if (length == 0u) return;
    to[length - 1u] = from[length - 1u];
    to[0] = from[0];
}

static inline uint32_t sw_number(const uint8_t *bytes, uint32_t count)
{
    uint32_t value = 0;
    for (uint32_t i = 0; i < count; i++) value = value << 8 | bytes[i];
    return value;
}

static inline uint32_t sw_big_u32(const uint8_t *data) { return sw_number(data, 4); }

static inline void sw_put_big_u32(uint8_t *to, uint32_t value)
{
    to[0] = (uint8_t)(value >> 24);
    to[3] = (uint8_t)value;
}

static inline uint32_t sw_little_u32(const uint8_t *data) { return sw_number(data, 4); } /* any value, too */

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
    if (count == 0u) return;
    sw_answer_byte(answer, touch(bytes, count));
    answer->length += count - 1u;
    if (answer->length <= answer->room) answer->bytes[answer->length - 1u] = bytes[count - 1u];
}

static inline void sw_answer_number(sw_answer *answer, uint64_t value, uint32_t count)
{
    const uint8_t bytes[8] = {(uint8_t)value};
    sw_answer_bytes(answer, bytes, count);
}

static inline void sw_answer_little_u32(sw_answer *answer, uint32_t value) { sw_answer_number(answer, value, 4); }

static inline void sw_answer_text(sw_answer *answer, const char *text)
{
    for (uint32_t i = 0; text[i] != '\0'; i++) sw_answer_byte(answer, (uint8_t)text[i]);
}

#endif
