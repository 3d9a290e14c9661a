/* The seed and the key of XCP, in parts that fit into one packet. */
#include "sw_xcp_access.h"

#if SW_XCP

#define PIECE (SW_XCP_MAX_CTO - 2u) /* number of bytes of a seed or a key per packet */

static void forget(sw_xcp_access *access)
{
    access->has_seed = 0;
    access->unsent = 0;
    access->key_bytes = 0;
}

static uint8_t begin_seed(sw_xcp_access *access, uint32_t resource, sw_random random, void *context)
{
    uint32_t any = 0;
    forget(access);
    if (resource != SW_XCP_CAL_PAG) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (access->is_unlocked) return SW_XCP_DONE;
    if (random(context, access->seed, SW_XCP_SEED_LENGTH) != 0) return SW_XCP_ERROR_GENERIC;
    for (uint32_t i = 0; i < SW_XCP_SEED_LENGTH; i++) any |= access->seed[i];
    if (any == 0u) return SW_XCP_ERROR_GENERIC;
    access->has_seed = 1;
    access->unsent = SW_XCP_SEED_LENGTH;
    return SW_XCP_DONE;
}

uint8_t sw_xcp_access_seed(sw_xcp_access *access, const uint8_t *data, sw_random random, void *context, sw_answer *answer)
{
    uint8_t code = SW_XCP_DONE;
    if (data[1] == 0u) {
        code = begin_seed(access, data[2], random, context);
    } else if (data[1] != 1u) {
        code = SW_XCP_ERROR_OUT_OF_RANGE;
    } else if (access->unsent == 0u) {
        code = SW_XCP_ERROR_SEQUENCE;
    } else {
        /* Mode 1 requests the rest of the seed. */
    }
    if (code != SW_XCP_DONE) return code;
    const uint32_t piece = access->unsent < PIECE ? access->unsent : PIECE;
    sw_answer_byte(answer, access->unsent);
    sw_answer_bytes(answer, &access->seed[SW_XCP_SEED_LENGTH - access->unsent], piece);
    access->unsent = (uint8_t)(access->unsent - piece);
    return SW_XCP_DONE;
}

void sw_xcp_access_lock(sw_xcp_access *access)
{
    access->is_unlocked = 0;
    forget(access);
}

uint8_t sw_xcp_access_unlock(sw_xcp_access *access, const uint8_t *data, uint32_t length, const uint8_t *key)
{
    const uint32_t left = data[1];
    const uint32_t piece = left < PIECE ? left : PIECE;
    if (!access->has_seed || access->unsent > 0u || left != (uint32_t)SW_ANSWER_BYTES - access->key_bytes) {
        forget(access);
        return SW_XCP_ERROR_SEQUENCE;
    }
    if (length - 2u < piece) return SW_XCP_ERROR_CMD_SYNTAX;
    sw_bytes_copy(&access->key[access->key_bytes], &data[2], piece);
    access->key_bytes = (uint8_t)(access->key_bytes + piece);
    if (access->key_bytes == SW_ANSWER_BYTES) {
        uint8_t right[SW_ANSWER_BYTES];
        sw_access_answer(SW_LEVEL_CALIBRATION, key, access->seed, SW_XCP_SEED_LENGTH, right);
        forget(access);
        if (!sw_bytes_equal(right, access->key, SW_ANSWER_BYTES)) return SW_XCP_ERROR_ACCESS_LOCKED;
        access->is_unlocked = 1;
    }
    return SW_XCP_DONE;
}

#endif
