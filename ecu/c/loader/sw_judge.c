/* Reading a whole image from the flash, and every check of it: can_bridge/flashing/remembered.py, `judged`. */
#include "sw_store_parts.h"

#define READ 256u /* bytes at once */

void sw_judge_begin(sw_store *store, uint32_t slot)
{
    store->slot = (uint8_t)slot;
    store->at = 0;
    store->verdict = SW_VERDICT_GOOD;
    sw_sha256_begin(&store->scratch.image.whole);
    sw_sha256_begin(&store->scratch.image.payload);
    sw_bytes_fill(store->scratch.image.header, 0, SW_HEADER_BYTES);
}

static void take(sw_store *store, const uint8_t *data, uint32_t length)
{
    sw_sha256_add(&store->scratch.image.whole, data, length);
    /* READ divides the header. */
    if (store->at < SW_HEADER_BYTES) {
        sw_bytes_copy(&store->scratch.image.header[store->at], data, length);
    } else {
        sw_sha256_add(&store->scratch.image.payload, data, length);
    }
    store->at += length;
}

int sw_judge_go_on(sw_store *store)
{
    const uint32_t length = store->state.slots[store->slot].length;
    const uint32_t end = length - store->at < SW_PIECE ? length : store->at + SW_PIECE;
    while (store->at < end) {
        uint8_t data[READ];
        const uint32_t count = end - store->at < READ ? end - store->at : READ;
        const uint32_t address = sw_slots_address(store->slot) + store->at;
        if (store->flash->read(store->flash->context, address, data, count) != 0) {
            store->verdict = SW_VERDICT_UNREADABLE;
            return 0;
        }
        take(store, data, count);
    }
    return store->at < length;
}

sw_verdict sw_judge_end(sw_store *store)
{
    const sw_slot_state *standing = &store->state.slots[store->slot];
    uint8_t whole[32], payload[32];
    if (store->verdict != SW_VERDICT_GOOD) return SW_VERDICT_UNREADABLE;
    sw_sha256_end(&store->scratch.image.whole, whole);
    sw_sha256_end(&store->scratch.image.payload, payload);
    if (!sw_bytes_equal(whole, standing->sha256, 32)) return SW_VERDICT_WRONG_HASH;
    const sw_verdict verdict = sw_release_judge(store->scratch.image.header, standing->length, payload, store->keys,
                                                store->rules, store->state.least_security_version);
    if (verdict != SW_VERDICT_GOOD) return verdict;
    /* Read in place, as it will run: every word of it was readable. */
    const uint8_t *image = &store->flash->memory[sw_slots_address(store->slot)];
    return store->opens(image) ? SW_VERDICT_GOOD : SW_VERDICT_WRONG_BUILD;
}

sw_verdict sw_judge_slot(sw_store *store, uint32_t slot)
{
    sw_judge_begin(store, slot);
    while (sw_judge_go_on(store)) {
        /* At once. */
    }
    return sw_judge_end(store);
}
