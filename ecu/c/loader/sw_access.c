/* The security access: seeds and answers. */
#include "sw_access.h"

#include "sw_bytes.h"

#define LABEL "stillwake access"
#define LABEL_BYTES 16u

/* Returns a level's index in the arrays of sw_access. The level is the sub-function of its seed request: 1, 3, .. */
static uint32_t place_of(uint8_t level) { return (level - 1u) / 2u; }

static void close(sw_access *access, uint32_t place, int64_t now_ns)
{
    access->is_closed[place] = 1;
    access->closed_until_ns[place] = now_ns + SW_ACCESS_DELAY_NS;
}

/* Computes the expected answer. Each level has a separate key, so that no answer is valid for two levels. */
static void expected(uint8_t level, const uint8_t key[SW_AES_BYTES], const uint8_t *seed, uint32_t length,
                     uint8_t answer[SW_ANSWER_BYTES])
{
    static const char label[] = LABEL;
    uint8_t text[LABEL_BYTES + 1u];
    uint8_t own[SW_AES_BYTES];
    for (uint32_t i = 0; i < LABEL_BYTES; i++) text[i] = (uint8_t)label[i];
    text[LABEL_BYTES] = level;
    sw_aes_cmac(key, text, LABEL_BYTES + 1u, own);
    sw_aes_cmac(own, seed, length, answer);
}

#if SW_XCP
void sw_access_answer(uint8_t level, const uint8_t key[SW_AES_BYTES], const uint8_t *seed, uint32_t length,
                      uint8_t answer[SW_ANSWER_BYTES])
{
    expected(level, key, seed, length, answer);
}
#endif

void sw_access_power_on(sw_access *access, const sw_store *store, int64_t now_ns)
{
    for (uint32_t place = 0; place < SW_LEVELS; place++) {
        const uint8_t level = (uint8_t)(2u * place + 1u);
        if (sw_store_failed_attempts(store, level) >= SW_ACCESS_ATTEMPTS) close(access, place, now_ns);
    }
}

void sw_access_lock(sw_access *access)
{
    access->unlocked = 0;
    access->asked = 0;
}

uint8_t sw_access_seed(sw_access *access, int64_t now_ns, uint8_t level, sw_random random, void *context,
                       uint8_t seed[SW_SEED_BYTES])
{
    const uint32_t place = place_of(level);
    uint32_t any = 0;
    for (uint32_t i = 0; i < SW_SEED_BYTES; i++) seed[i] = 0;
    if (access->unlocked == level) return 0;
    access->asked = 0;
    if (access->is_closed[place] && now_ns < access->closed_until_ns[place]) return SW_NRC_DELAY_NOT_EXPIRED;
    if (random(context, seed, SW_SEED_BYTES) != 0) return SW_NRC_CONDITIONS_NOT_CORRECT;
    for (uint32_t i = 0; i < SW_SEED_BYTES; i++) {
        access->seed[i] = seed[i];
        any |= seed[i];
    }
    if (any == 0u) return SW_NRC_CONDITIONS_NOT_CORRECT; /* a seed of zeros would mean that the level is unlocked */
    access->asked = level;
    return 0;
}

uint8_t sw_access_unlock(sw_access *access, sw_store *store, int64_t now_ns, uint8_t level,
                         const uint8_t key[SW_AES_BYTES], const uint8_t answer[SW_ANSWER_BYTES])
{
    uint8_t right[SW_ANSWER_BYTES];
    if (access->asked != level) return SW_NRC_SEQUENCE_ERROR;
    access->asked = 0;
    const uint32_t count = (uint32_t)sw_store_failed_attempts(store, level) + 1u;
    /* Every attempt must be counted. While the jets run, no count can be stored if the record sector is full. */
    if (!sw_store_has_room(store)) return SW_NRC_CONDITIONS_NOT_CORRECT;
    if (sw_store_keep_failed_attempts(store, level, count) != SW_STORE_DONE) return SW_NRC_PROGRAMMING_FAILURE;
    expected(level, key, access->seed, SW_SEED_BYTES, right);
    if (!sw_bytes_equal(right, answer, SW_ANSWER_BYTES)) {
        if (count < SW_ACCESS_ATTEMPTS) return SW_NRC_INVALID_KEY;
        close(access, place_of(level), now_ns);
        return SW_NRC_EXCEEDED_ATTEMPTS;
    }
    if (sw_store_keep_failed_attempts(store, level, 0) != SW_STORE_DONE) return SW_NRC_PROGRAMMING_FAILURE;
    access->unlocked = level;
    return 0;
}
