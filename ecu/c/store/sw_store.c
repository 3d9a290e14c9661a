#include "sw_store.h"

#include "sw_bytes.h"

/* --- The bytes of a slot --- */

#define WORD SW_FLASH_WORD

uint32_t sw_slots_address(uint32_t slot) { return (SW_RECORD_SECTORS + slot * SW_SLOT_SECTORS) * SW_FLASH_SECTOR; }

static int is_blank(const sw_store *store, uint32_t address)
{
    uint8_t data[WORD];
    uint32_t all = 0xffu;
    if (store->flash->read(store->flash->context, address, data, WORD) != 0) return 0;
    for (uint32_t i = 0; i < WORD; i++) all &= data[i];
    return all == 0xffu;
}

/* Returns the offset at which writing can continue (the received bytes' end or a sector's start), or SW_NO_OFFSET. */
static uint32_t begin_again(const sw_store *store, uint32_t slot)
{
    const sw_slot_state *standing = &store->state.slots[slot];
    const uint32_t begin = standing->received / WORD * WORD;
    if (standing->received == standing->length) return standing->received;
    for (uint32_t at = begin; at < standing->length; at += WORD) {
        if (!is_blank(store, sw_slots_address(slot) + at)) {
            /* A word can be written only once, so a sector with a word of unknown content must be erased. */
            const uint32_t sector = standing->received / SW_FLASH_SECTOR * SW_FLASH_SECTOR;
            return sector > 0u ? sector : SW_NO_OFFSET;
        }
    }
    return standing->received;
}

static int written(const sw_store *store, uint32_t address, const uint8_t word[WORD])
{
    uint8_t found[WORD];
    if (store->flash->program(store->flash->context, address, word) != 0) return 1;
    if (store->flash->read(store->flash->context, address, found, WORD) != 0) return 1;
    return !sw_bytes_equal(found, word, WORD);
}

/* Writes a slot's bytes from `from` on; `tail` has the slot's last incomplete word. Returns 1 if the memory failed. */
static int write_bytes(const sw_store *store, uint32_t slot, uint32_t from, uint8_t *tail, const uint8_t *data,
                       uint32_t length)
{
    for (uint32_t at = from; at < from + length; at++) {
        const uint32_t place = at % WORD;
        if (place == 0u) sw_bytes_fill(tail, 0xff, WORD);
        tail[place] = data[at - from];
        if ((place == WORD - 1u || at + 1u == store->state.slots[slot].length)
            && written(store, sw_slots_address(slot) + at - place, tail) != 0) {
            return 1;
        }
    }
    return 0;
}

/* --- The slots, and the operations on them --- */

/* Returns whether a slot's image failed a check at the boot, so that it has to be transferred again. */
static int is_known_bad(const sw_store *store, uint32_t slot)
{
    const uint8_t phase = store->state.slots[slot].phase;
    return (phase == SW_PHASE_TRIAL || phase == SW_PHASE_CONFIRMED) && store->verdicts[slot] != SW_VERDICT_GOOD
           && store->verdicts[slot] != SW_VERDICT_NONE;
}

/* Returns the slot that is not protected. The running release is protected if it is confirmed; otherwise the confirmed
 * release is protected. Between a revert and the reset the function returns SW_NO_SLOT.
 */
static uint32_t writable_slot(const sw_store *store)
{
    const uint32_t active = store->state.active;
    const uint32_t running = store->running;
    if (running == SW_NO_SLOT
        || (active != SW_NO_SLOT && store->state.slots[running].phase != SW_PHASE_CONFIRMED)) {
        return active == SW_NO_SLOT ? 0u : 1u - active;
    }
    if (active != SW_NO_SLOT && running != active && !is_known_bad(store, active)) return SW_NO_SLOT;
    return 1u - running;
}

/* Drafts the state in which the slot is empty. The other slot is active in this state if its release is confirmed. */
static sw_store_state *without(sw_store *store, uint32_t slot)
{
    sw_store_state *next = sw_state_draft(store);
    sw_state_empty_slot(&next->slots[slot]);
    next->active = (uint8_t)(next->slots[1u - slot].phase == SW_PHASE_CONFIRMED ? 1u - slot : SW_NO_SLOT);
    return next;
}

static int holds(const sw_slot_state *slot, const sw_slot_state *other)
{
    return slot->phase != SW_PHASE_EMPTY && slot->phase != SW_PHASE_BAD && slot->length == other->length
           && sw_bytes_equal(slot->sha256, other->sha256, 32);
}

int sw_store_is_erasing(const sw_store *store) { return store->records.is_erasing; }

/* Drops the work in progress. If this work is an erasure, waits until the erasure has ended. */
static void drop_work(sw_store *store)
{
    const int clears = store->work == SW_WORK_CLEAR;
    store->work = SW_WORK_NONE;
    while (clears && sw_store_is_erasing(store)) (void)sw_records_erased(&store->records);
}

void sw_store_drop(sw_store *store)
{
    drop_work(store);
    store->announced = SW_NO_SLOT;
}

/* Completes the announcement of an image: the slot's memory after the received bytes is now writable. */
static sw_store_result announced(sw_store *store)
{
    const sw_slot_state *announced_slot = &store->scratch.next.slot;
    store->work = SW_WORK_NONE;
    if (!sw_state_slots_equal(announced_slot, &store->state.slots[store->slot])) {
        sw_store_state *next = without(store, store->slot);
        next->slots[store->slot] = *announced_slot;
        if (sw_state_keep(store, next) != 0) return SW_STORE_BAD_MEMORY;
    }
    store->wanted = announced_slot->received;
    store->announced = store->slot;
    return SW_STORE_DONE;
}

sw_store_result sw_store_announce(sw_store *store, uint32_t length, const uint8_t sha256[32])
{
    sw_slot_state *next = &store->scratch.next.slot;
    drop_work(store);
    if (length == 0u || length > SW_SLOT_BYTES) return SW_STORE_OUT_OF_RANGE;
    const uint32_t slot = writable_slot(store);
    if (slot == SW_NO_SLOT) return SW_STORE_OUT_OF_ORDER;
    const sw_slot_state *standing = &store->state.slots[slot];
    store->announced = SW_NO_SLOT;
    if (store->running == slot) store->running = SW_NO_SLOT;
    store->slot = (uint8_t)slot;
    sw_state_empty_slot(next);
    next->phase = SW_PHASE_FILLING;
    next->length = length;
    sw_bytes_copy(next->sha256, sha256, 32);
    uint32_t wanted = SW_NO_OFFSET;
    if (holds(standing, next) && !is_known_bad(store, slot)) wanted = begin_again(store, slot);
    if (wanted == standing->received) {
        next->received = wanted;
        return announced(store);
    }
    /* The state is stored before the erasure, and counts only the bytes that the erasure keeps. */
    sw_store_state *state = without(store, slot);
    if (wanted != SW_NO_OFFSET) {
        next->received = wanted;
        state->slots[slot] = *next;
    }
    if (sw_state_keep(store, state) != 0) return SW_STORE_BAD_MEMORY;
    store->at = next->received / SW_FLASH_SECTOR;
    store->work = SW_WORK_CLEAR;
    return SW_STORE_MORE;
}

/* Writes the next part of the bytes, and counts it in the draft of the state (in the scratch memory). After the last
 * part the draft is stored; from then on all these bytes count as received.
 */
static sw_store_result appended(sw_store *store)
{
    sw_store_state *next = &store->scratch.next.state;
    sw_slot_state *filling = &next->slots[store->slot];
    const uint32_t left = store->until - store->at;
    const uint32_t count = left < SW_WRITTEN ? left : SW_WRITTEN;
    store->work = SW_WORK_NONE;
    if (write_bytes(store, store->slot, filling->received, next->tail[store->slot], &store->data[store->at], count) != 0) {
        return SW_STORE_BAD_MEMORY;
    }
    filling->received += count;
    store->at += count;
    if (count < left) {
        store->work = SW_WORK_APPEND;
        return SW_STORE_MORE;
    }
    if (sw_state_keep(store, next) != 0) return SW_STORE_BAD_MEMORY;
    store->announced = store->slot;
    return SW_STORE_DONE;
}

sw_store_result sw_store_append(sw_store *store, const uint8_t *data, uint32_t length)
{
    const uint32_t slot = store->announced;
    drop_work(store);
    if (slot == SW_NO_SLOT) return SW_STORE_OUT_OF_ORDER;
    const sw_slot_state *standing = &store->state.slots[slot];
    if (standing->phase != SW_PHASE_FILLING || length > standing->length - standing->received) {
        return SW_STORE_OUT_OF_ORDER;
    }
    (void)sw_state_draft(store);
    store->announced = SW_NO_SLOT;
    store->slot = (uint8_t)slot;
    store->data = data;
    store->at = 0;
    store->until = length;
    return appended(store);
}

sw_store_result sw_store_finish(sw_store *store)
{
    const uint32_t slot = store->announced;
    drop_work(store);
    if (slot == SW_NO_SLOT) return SW_STORE_OUT_OF_ORDER;
    if (store->state.slots[slot].received < store->state.slots[slot].length) {
        store->verdict = SW_VERDICT_INCOMPLETE;
        return SW_STORE_DONE;
    }
    sw_judge_begin(store, slot);
    store->work = SW_WORK_FINISH;
    return SW_STORE_MORE;
}

static sw_store_result finished(sw_store *store)
{
    const sw_slot_state *standing = &store->state.slots[store->slot];
    sw_release_facts facts;
    store->verdict = (uint8_t)sw_judge_end(store);
    if (store->verdict == SW_VERDICT_GOOD) sw_release_read(store->scratch.image.header, &facts);
    sw_store_state *next = sw_state_draft(store);
    sw_slot_state *checked = &next->slots[store->slot];
    sw_state_empty_slot(checked);
    checked->phase = SW_PHASE_BAD;
    checked->length = standing->length;
    checked->received = standing->received;
    sw_bytes_copy(checked->sha256, standing->sha256, 32);
    if (store->verdict == SW_VERDICT_GOOD) {
        checked->phase = SW_PHASE_CHECKED;
        checked->facts = facts;
    }
    if (sw_state_slots_equal(checked, standing)) return SW_STORE_DONE;
    return sw_state_keep(store, next) == 0 ? SW_STORE_DONE : SW_STORE_BAD_MEMORY;
}

static sw_store_result reverted(sw_store *store)
{
    store->verdict = (uint8_t)sw_judge_end(store);
    if (store->verdict != SW_VERDICT_GOOD || store->state.active == store->slot) return SW_STORE_DONE;
    sw_store_state *next = sw_state_draft(store);
    next->active = store->slot;
    return sw_state_keep(store, next) == 0 ? SW_STORE_DONE : SW_STORE_BAD_MEMORY;
}

/* Begins to erase the next sector, or checks the progress of an erasure. */
static sw_store_result cleared(sw_store *store)
{
    const uint32_t sector = SW_RECORD_SECTORS + store->slot * SW_SLOT_SECTORS + store->at;
    sw_flash_state state = SW_FLASH_FAILED;
    if (sw_store_is_erasing(store) || sw_records_begin_erasing(&store->records, sector) == 0) {
        state = sw_records_erased(&store->records);
    }
    if (state == SW_FLASH_AT_WORK) return SW_STORE_MORE;
    if (state == SW_FLASH_FAILED) {
        store->work = SW_WORK_NONE;
        return SW_STORE_BAD_MEMORY;
    }
    store->at++;
    return store->at < SW_SLOT_SECTORS ? SW_STORE_MORE : announced(store);
}

sw_store_result sw_store_go_on(sw_store *store)
{
    const uint8_t work = store->work;
    if (work == SW_WORK_NONE) return SW_STORE_DONE;
    if (work == SW_WORK_CLEAR) return cleared(store);
    if (work == SW_WORK_APPEND) return appended(store);
    if (sw_judge_go_on(store)) return SW_STORE_MORE;
    store->work = SW_WORK_NONE;
    return work == SW_WORK_FINISH ? finished(store) : reverted(store);
}

sw_store_result sw_store_activate(sw_store *store)
{
    const uint32_t slot = sw_state_in_phase(&store->state, SW_PHASE_CHECKED);
    const uint32_t trial = sw_state_in_phase(&store->state, SW_PHASE_TRIAL);
    drop_work(store);
    if (slot == SW_NO_SLOT) {
        return trial != SW_NO_SLOT && trial != store->running ? SW_STORE_DONE : SW_STORE_OUT_OF_ORDER;
    }
    sw_store_state *next = sw_state_draft(store);
    if (trial != SW_NO_SLOT) sw_state_give_up(&next->slots[trial]);
    next->slots[slot].phase = SW_PHASE_TRIAL;
    next->slots[slot].boots_left = SW_TRIAL_BOOTS;
    if (sw_state_keep(store, next) != 0) return SW_STORE_BAD_MEMORY;
    store->announced = SW_NO_SLOT;
    return SW_STORE_DONE;
}

sw_store_result sw_store_confirm(sw_store *store)
{
    const uint32_t slot = store->running;
    drop_work(store);
    if (slot == SW_NO_SLOT) return SW_STORE_OUT_OF_ORDER;
    sw_store_state *next = sw_state_draft(store);
    sw_slot_state *standing = &next->slots[slot];
    if (standing->phase == SW_PHASE_CONFIRMED) return SW_STORE_DONE;
    /* A release whose key was removed from the list must not be confirmed: it would not boot again, and the earlier
     * release's version might be below the new minimum.
     */
    if (standing->phase != SW_PHASE_TRIAL || !sw_key_is_allowed(store->keys, standing->facts.signer)) {
        return SW_STORE_OUT_OF_ORDER;
    }
    standing->phase = SW_PHASE_CONFIRMED;
    standing->boots_left = 0;
    next->active = (uint8_t)slot;
    if (standing->facts.security_version > next->least_security_version) {
        next->least_security_version = standing->facts.security_version;
    }
    return sw_state_keep(store, next) == 0 ? SW_STORE_DONE : SW_STORE_BAD_MEMORY;
}

sw_store_result sw_store_revert(sw_store *store)
{
    const uint32_t trial = sw_state_in_phase(&store->state, SW_PHASE_TRIAL);
    /* A revert goes back from the running release, not from the active release. A tester that missed the answer repeats
     * its request, and the repeated request must not undo the first request.
     */
    const uint32_t now = store->running != SW_NO_SLOT ? store->running : store->state.active;
    drop_work(store);
    if (trial != SW_NO_SLOT) {
        sw_store_state *next = sw_state_draft(store);
        sw_state_give_up(&next->slots[trial]);
        store->verdict = SW_VERDICT_GOOD;
        return sw_state_keep(store, next) == 0 ? SW_STORE_DONE : SW_STORE_BAD_MEMORY;
    }
    if (now == SW_NO_SLOT || store->state.slots[1u - now].phase != SW_PHASE_CONFIRMED) return SW_STORE_OUT_OF_ORDER;
    sw_judge_begin(store, 1u - now);
    store->work = SW_WORK_REVERT;
    return SW_STORE_MORE;
}

uint32_t sw_store_received(const sw_store *store)
{
    return store->announced == SW_NO_SLOT ? SW_NO_OFFSET : store->state.slots[store->announced].received;
}
