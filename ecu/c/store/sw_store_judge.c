/* The images in the flash: the checks of an image, the choice of the image to boot, and the report for testers. This
 * file corresponds to store.py, report.py (the report's layout) and `judged` of remembered.py in can_bridge/flashing.
 */
#include "sw_store.h"

#include "sw_bytes.h"

#define READ 256u /* number of bytes per read */

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
    /* The header's length is a multiple of READ. */
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
    /* The image is now read in place in the flash. The hash has shown that all words are readable. */
    const uint8_t *image = &store->flash->memory[sw_slots_address(store->slot)];
    return store->opens(image) ? SW_VERDICT_GOOD : SW_VERDICT_WRONG_BUILD;
}

static sw_verdict judged(sw_store *store, uint32_t slot)
{
    sw_judge_begin(store, slot);
    while (sw_judge_go_on(store)) {
        /* Before control begins, the parts follow each other without a pause. */
    }
    return sw_judge_end(store);
}

/* --- Boot --- */

/* Boots the image on trial if it has boots left and is valid; otherwise rejects the image. */
static int boot_trial(sw_store *store, uint32_t slot)
{
    sw_store_state *next = sw_state_draft(store);
    if (next->slots[slot].boots_left > 0u) {
        /* The boot is counted first, so that the number of boots is limited. If the boot cannot be counted, the image
         * does not run, because the trial would never end.
         */
        next->slots[slot].boots_left--;
        if (sw_state_keep(store, next) != 0) {
            store->verdicts[slot] = SW_VERDICT_UNREADABLE;
            return 0;
        }
        store->verdicts[slot] = (uint8_t)judged(store, slot);
        if (store->verdicts[slot] == SW_VERDICT_GOOD) return 1;
    }
    next = sw_state_draft(store);
    sw_state_give_up(&next->slots[slot]);
    if (sw_state_keep(store, next) != 0 && store->verdicts[slot] == SW_VERDICT_NONE) {
        store->verdicts[slot] = SW_VERDICT_UNREADABLE;
    }
    return 0;
}

/* Boots the active or else the previous image. An image that fails stays confirmed; the next boot checks it again. */
static void boot_confirmed(sw_store *store, int is_reverted)
{
    const uint32_t active = store->state.active;
    store->reason = SW_BOOT_NO_RELEASE;
    if (active == SW_NO_SLOT) return;
    for (uint32_t i = 0; i < 2u && store->running == SW_NO_SLOT; i++) {
        const uint32_t slot = active ^ i;
        if (store->state.slots[slot].phase != SW_PHASE_CONFIRMED) continue;
        store->verdicts[slot] = (uint8_t)judged(store, slot);
        if (store->verdicts[slot] == SW_VERDICT_GOOD) {
            store->running = (uint8_t)slot;
            store->reason = is_reverted ? SW_BOOT_REVERTED : SW_BOOT_CONFIRMED;
            if (i > 0u) store->reason = SW_BOOT_FALLBACK;
        }
    }
}

void sw_store_boot(sw_store *store)
{
    const uint32_t trial = sw_state_in_phase(&store->state, SW_PHASE_TRIAL);
    sw_store_drop(store);
    store->running = SW_NO_SLOT;
    store->verdicts[0] = SW_VERDICT_NONE;
    store->verdicts[1] = SW_VERDICT_NONE;
    if (trial != SW_NO_SLOT && boot_trial(store, trial)) {
        store->running = (uint8_t)trial;
        store->reason = SW_BOOT_TRIAL;
    } else {
        boot_confirmed(store, trial != SW_NO_SLOT);
    }
}

int sw_store_read_image(const sw_store *store, uint8_t *data, uint32_t length)
{
    return store->flash->read(store->flash->context, sw_slots_address(store->running), data, length);
}

const uint8_t *sw_store_image(const sw_store *store)
{
    return store->running == SW_NO_SLOT ? 0 : &store->flash->memory[sw_slots_address(store->running)];
}

/* --- Report --- */

#define HEAD 18u
#define SLOT 49u /* number of bytes of a slot in the report before the release's name */

static uint32_t next_boot(const sw_store_state *state)
{
    const uint32_t trial = sw_state_in_phase(state, SW_PHASE_TRIAL);
    return trial != SW_NO_SLOT && state->slots[trial].boots_left > 0u ? trial : state->active;
}

uint32_t sw_store_report(const sw_store *store, uint8_t *data)
{
    static const uint8_t magic[4] = {'S', 'W', 'T', '1'};
    const sw_store_state *state = &store->state;
    uint32_t at = HEAD;
    sw_bytes_copy(data, magic, 4);
    data[4] = store->running;
    data[5] = state->active;
    data[6] = (uint8_t)next_boot(state);
    data[7] = store->reason;
    sw_put_big_u32(&data[8], state->least_security_version);
    sw_put_big_u32(&data[12], sw_key_list_version(store->keys));
    sw_bytes_copy(&data[16], state->attempts, 2);
    for (uint32_t i = 0; i < 2u; i++) {
        const sw_slot_state *slot = &state->slots[i];
        data[at] = slot->phase;
        data[at + 1u] = store->verdicts[i];
        data[at + 2u] = slot->boots_left;
        data[at + 3u] = 0;
        data[at + 4u] = slot->facts.name_length;
        sw_put_big_u32(&data[at + 5u], slot->facts.security_version);
        sw_put_big_u32(&data[at + 9u], slot->received);
        sw_put_big_u32(&data[at + 13u], slot->length);
        sw_bytes_copy(&data[at + 17u], slot->facts.digest, 32);
        sw_bytes_copy(&data[at + SLOT], slot->facts.name, slot->facts.name_length);
        at += SLOT + slot->facts.name_length;
    }
    return at;
}
