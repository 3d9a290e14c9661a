/* What is allowed: the judgement of a step, a boot, a running release and the memory. A part of store_states.c. */
#ifndef STORE_RULES_H
#define STORE_RULES_H

/* Returns which release is in a slot, byte by byte; IMAGES: none. */
static uint32_t release_in(uint32_t slot)
{
    for (uint32_t i = 0; i < IMAGES; i++) {
        int same = memcmp(&now.memory[sw_slots_address(slot)], images[i], IMAGE) == 0;
        for (uint32_t k = 0; k < IMAGE / WORD; k++) same &= !now.unreadable[sw_slots_address(slot) / WORD + k];
        if (same) return i;
    }
    return IMAGES;
}

/* Returns whether a slot has a release that may run by this key list and this least version. */
static int may_run(uint32_t slot, uint32_t list, uint32_t least)
{
    const uint32_t release = release_in(slot);
    return release < IMAGES && made[release].version >= least && made[release].key <= (list == 1u ? 1u : 0u);
}

static int is_given_up(const sw_slot_state *before, const sw_slot_state *after)
{
    return before->phase == SW_PHASE_TRIAL && after->phase == SW_PHASE_BAD && after->boots_left == 0u;
}

/* Whether a call may change a slot in this way. */
static int may_become(const world_state *was, uint32_t slot)
{
    const sw_slot_state *before = &was->store.state.slots[slot], *after = &now.store.state.slots[slot];
    const int is_announced = was->store.announced == slot;
    switch (call_now) {
    case POWER: /* a boot on trial is counted, or the release is given up */
        return is_given_up(before, after)
               || (before->phase == SW_PHASE_TRIAL && after->phase == SW_PHASE_TRIAL
                   && after->boots_left + 1u == before->boots_left);
    case ANNOUNCE + OLD:
    case ANNOUNCE + NEW:
    case ANNOUNCE + FOREIGN:
        if (slot == was->store.state.active) return 0;
        if (was->store.running == slot && before->phase == SW_PHASE_CONFIRMED) return 0;
        return after->phase <= SW_PHASE_FILLING && after->facts.name_length == 0u && after->received <= before->received
               && (after->received == 0u || memcmp(before->sha256, after->sha256, 32) == 0);
    case APPEND:
    case SPOILT:
        return is_announced && before->phase == SW_PHASE_FILLING && after->phase == SW_PHASE_FILLING
               && after->received > before->received && after->received <= after->length;
    case FINISH:
        if (!is_announced || before->received != before->length) return 0;
        if (after->phase == SW_PHASE_BAD) return 1;
        return after->phase == SW_PHASE_CHECKED
               && may_run(slot, sw_key_list_version(was->store.keys), was->store.state.least_security_version);
    case ACTIVATE:
        return is_given_up(before, after)
               || (before->phase == SW_PHASE_CHECKED && after->phase == SW_PHASE_TRIAL
                   && after->boots_left == SW_TRIAL_BOOTS);
    case CONFIRM:
        return was->store.running == slot && before->phase == SW_PHASE_TRIAL && after->phase == SW_PHASE_CONFIRMED
               && now.store.state.active == slot;
    case REVERT:
        return is_given_up(before, after);
    default:
        return 0;
    }
}

/* Judges a step: what was before, and what is now, in the records and in both slots. */
static void judge_step(const world_state *was)
{
    const sw_store_state *before = &was->store.state, *after = &now.store.state;
    const uint32_t least = after->least_security_version;
    const uint32_t list = sw_key_list_version(now.store.keys);
    uint32_t rises = before->least_security_version;
    for (uint32_t slot = 0; slot < 2u; slot++) {
        const sw_slot_state *one = &after->slots[slot];
        if (sw_state_slots_equal(&before->slots[slot], one)) continue;
        must(may_become(was, slot), "a slot changes as it must not");
        if (call_now == CONFIRM && one->facts.security_version > rises) rises = one->facts.security_version;
    }
    must(least == rises, "the least security version is not that of the newest confirmed release");
    must(list >= sw_key_list_version(was->store.keys), "an old key list is back");
    must(call_now == REVERT || call_now == CONFIRM || after->active == before->active, "another release is active");
    must(after->active < 2u && after->slots[after->active].phase == SW_PHASE_CONFIRMED, "no release is active");
    must(may_run(after->active, list, least), "the active release could not run");
    must(made[release_in(after->active)].version <= least, "a release older than the confirmed one could run");
}

/* A boot to its end runs a release that may run; on trial it was counted before. */
static void judge_boot(const world_state *was)
{
    const sw_store *store = &now.store;
    const uint32_t running = store->running;
    boots++;
    must(running < 2u, "no release runs");
    must(store->reason != SW_BOOT_FALLBACK, "the confirmed release is passed over");
    const uint32_t boots_before = was->store.state.slots[running].boots_left;
    if (store->state.slots[running].phase == SW_PHASE_TRIAL) {
        trials++;
        must(boots_before > 0u && boots_before <= SW_TRIAL_BOOTS, "a release that was not confirmed in time runs");
        must(store->state.slots[running].boots_left == boots_before - 1u, "a boot on trial is not counted");
    } else {
        must(running == store->state.active, "a release runs that is neither confirmed nor on trial");
    }
}

/* While a release runs it stands there whole: it is read in place. */
static void judge_running(void)
{
    const uint32_t running = now.store.running;
    if (running == SW_NO_SLOT) return;
    must(release_in(running) < FOREIGN || release_in(running) == NEXT, "a release by a stranger runs");
    must(made[release_in(running)].version >= now.store.state.least_security_version, "an older release runs");
}

/* What is in memory is what a power-on would find. */
static void judge_memory(void)
{
    const sw_store held = now.store;
    const memory_facts facts = facts_of();
    found_in_flash(&facts);
    const sw_store_state *one = &held.state, *other = &now.store.state;
    int same = one->active == other->active && one->least_security_version == other->least_security_version
               && memcmp(one->attempts, other->attempts, 2) == 0 && memcmp(held.keys, now.store.keys, sizeof lists[0]) == 0
               && held.records.end == now.store.records.end && held.records.sector == now.store.records.sector;
    for (uint32_t i = 0; i < 2u; i++) {
        const uint32_t tail = one->slots[i].received % WORD;
        same &= sw_state_slots_equal(&one->slots[i], &other->slots[i]) && memcmp(one->tail[i], other->tail[i], tail) == 0;
    }
    must(same, "memory has another state than the records");
}

#endif
