/* An answer that is being written, in big-endian order. Bytes beyond its room are counted and not kept. */
#ifndef SW_ANSWER_H
#define SW_ANSWER_H

#include <stdint.h>

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

/* The lowest `count` bytes of a number. */
static inline void sw_answer_number(sw_answer *answer, uint64_t value, uint32_t count)
{
    for (uint32_t i = count; i > 0u; i--) sw_answer_byte(answer, (uint32_t)(value >> (8u * (i - 1u)) & 0xffu));
}

static inline void sw_answer_text(sw_answer *answer, const char *text)
{
    for (uint32_t i = 0; text[i] != '\0'; i++) sw_answer_byte(answer, (uint8_t)text[i]);
}

/* The number that `count` bytes are, 4 at most. */
static inline uint32_t sw_number(const uint8_t *bytes, uint32_t count)
{
    uint32_t value = 0;
    for (uint32_t i = 0; i < count; i++) value = value << 8 | bytes[i];
    return value;
}

#endif
