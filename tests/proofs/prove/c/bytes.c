/* The loops over bytes that bytes_model.h stands for elsewhere: they touch so many bytes, and say what they should. */
#include "prove.h"

#include "sw_bytes.h"

#define MOST 8u

void any_bytes(void)
{
    uint8_t one[MOST], other[MOST], room[MOST];
    const uint32_t length = nondet_uint(), count = nondet_uint(), at = nondet_uint();
    ASSUME(length <= MOST && count <= 4u && at < length);
    /* At the end of their arrays, so that a byte too many is out of bounds. */
    uint8_t *to = &other[MOST - length];
    const uint8_t *from = &one[MOST - length];
    if (sw_bytes_equal(from, to, length)) PROVE(from[at] == to[at]);
    sw_bytes_copy(to, from, length);
    PROVE(to[at] == from[at] && sw_bytes_equal(from, to, length));
    sw_bytes_fill(to, 7, length);
    PROVE(to[at] == 7u);
    (void)sw_number(&one[MOST - count], count);
    sw_put_big_u32(&room[MOST - 4u], nondet_uint());
    sw_answer answer = {to, length, 0};
    sw_answer_bytes(&answer, one, MOST);
    PROVE(answer.length == MOST && to[at] == one[at]);
}
