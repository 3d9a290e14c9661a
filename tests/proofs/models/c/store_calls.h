/* The calls of the store, and a whole update, from the present state. A part of store_states.c. */
#ifndef STORE_CALLS_H
#define STORE_CALLS_H

static sw_store_result gone_on(sw_store_result result, uint32_t *pieces)
{
    for (*pieces = 0; result == SW_STORE_MORE; (*pieces)++) {
        if (*pieces == piece_now) {
            sw_store_drop(&now.store);
            return SW_STORE_MORE;
        }
        result = sw_store_go_on(&now.store);
    }
    return result;
}

static sw_store_result append_next(int spoilt, uint32_t *pieces)
{
    static uint8_t data[IMAGE];
    const uint32_t slot = now.store.announced;
    uint32_t which = 0;
    if (slot == SW_NO_SLOT) return SW_STORE_OUT_OF_ORDER;
    const sw_slot_state *filling = &now.store.state.slots[slot];
    while (which < NEXT && memcmp(hashes[which], filling->sha256, 32) != 0) which++;
    const uint32_t at = filling->received, left = filling->length - at;
    memcpy(data, &images[which][at], left);
    if (spoilt) data[0] ^= 1u;
    return gone_on(sw_store_append(&now.store, data, left < BLOCK ? left : (at == 0u ? BLOCK : left)), pieces);
}

static void power_on(void)
{
    memset(&now.store, 0xa5, sizeof now.store);
    now.powered = 1;
    sw_store_open(&now.store, &flash, &rules, opens);
    sw_store_boot(&now.store);
    now.store.records.limit = SW_RECORDS_MOVE; /* as sw_node_init */
}

/* Returns how many pieces of work the call has after its first. */
static uint32_t perform(uint32_t call)
{
    sw_store *store = &now.store;
    uint32_t pieces = 0;
    switch (call) {
    case POWER:
        power_on();
        break;
    case ANNOUNCE + OLD:
    case ANNOUNCE + NEW:
    case ANNOUNCE + FOREIGN:
        (void)gone_on(sw_store_announce(store, IMAGE, hashes[call - ANNOUNCE]), &pieces);
        break;
    case APPEND:
    case SPOILT:
        (void)append_next(call == SPOILT, &pieces);
        break;
    case FINISH:
        (void)gone_on(sw_store_finish(store), &pieces);
        break;
    case ACTIVATE:
        (void)sw_store_activate(store);
        break;
    case CONFIRM:
        (void)sw_store_confirm(store);
        break;
    case REVERT:
        (void)gone_on(sw_store_revert(store), &pieces);
        break;
    case DROP:
        sw_store_drop(store);
        break;
    case OLD_KEYS:
    case KEYS:
        (void)sw_store_take_keys(store, lists[call - OLD_KEYS], (uint32_t)sizeof lists[0]);
        break;
    default:
        do sw_records_care(&store->records);
        while (sw_store_is_erasing(store));
        break;
    }
    return pieces;
}

/* --- Liveness: whatever came before, a newer release can be flashed and confirmed --- */

static sw_store *cared(void)
{
    for (uint32_t i = 0; i < 3u; i++) (void)perform(CARE);
    return &now.store;
}

static int is_on_trial(uint32_t which)
{
    uint32_t pieces = 0;
    if (gone_on(sw_store_announce(cared(), IMAGE, hashes[which]), &pieces) != SW_STORE_DONE) return 0;
    while (sw_store_received(cared()) < IMAGE) {
        if (append_next(0, &pieces) != SW_STORE_DONE) return 0;
    }
    if (gone_on(sw_store_finish(cared()), &pieces) != SW_STORE_DONE || now.store.verdict != SW_VERDICT_GOOD) return 0;
    if (sw_store_activate(cared()) != SW_STORE_DONE) return 0;
    power_on();
    return 1;
}

static int is_flashed(uint32_t which) { return is_on_trial(which) && sw_store_confirm(cared()) == SW_STORE_DONE; }

static void judge_recovery(void)
{
    const world_state kept = now;
    recoveries++;
    cut_at = NEVER;
    power_on();
    must(is_flashed(NEXT), "no release can be flashed any more");
    power_on();
    must(now.store.running < 2u && release_in(now.store.running) == NEXT && now.store.reason == SW_BOOT_CONFIRMED,
         "a release that was confirmed does not run");
    now = kept;
}

#endif
