/* Which image is booted, and why: the twin of can_bridge/flashing/boot.py. */
#include "sw_store_parts.h"

/* The image on trial, if it may be booted once more and is in order; otherwise it is given up. */
static int boot_trial(sw_store *store, uint32_t slot)
{
    sw_store_state *next = sw_state_draft(store);
    if (next->slots[slot].boots_left > 0u) {
        /* Counted first: whatever the image does to the ECU, the boots end. A trial that cannot be counted would never
         * end, so the image does not run.
         */
        next->slots[slot].boots_left--;
        if (sw_state_keep(store, next) != 0) {
            store->verdicts[slot] = SW_VERDICT_UNREADABLE;
            return 0;
        }
        store->verdicts[slot] = (uint8_t)sw_judge_slot(store, slot);
        if (store->verdicts[slot] == SW_VERDICT_GOOD) return 1;
    }
    next = sw_state_draft(store);
    sw_state_give_up(&next->slots[slot]);
    if (sw_state_keep(store, next) != 0 && store->verdicts[slot] == SW_VERDICT_NONE) {
        store->verdicts[slot] = SW_VERDICT_UNREADABLE;
    }
    return 0;
}

/* The confirmed image, or the one confirmed before it. One that fails stays confirmed, and is judged again at the next
 * boot.
 */
static void boot_confirmed(sw_store *store, int is_reverted)
{
    const uint32_t active = store->state.active;
    store->reason = SW_BOOT_NO_RELEASE;
    if (active == SW_NO_SLOT) return;
    for (uint32_t i = 0; i < 2u && store->running == SW_NO_SLOT; i++) {
        const uint32_t slot = active ^ i;
        if (store->state.slots[slot].phase != SW_PHASE_CONFIRMED) continue;
        store->verdicts[slot] = (uint8_t)sw_judge_slot(store, slot);
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
