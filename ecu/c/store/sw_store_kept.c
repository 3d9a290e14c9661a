/* The data that survive a power loss. The record of the slots begins with the same bytes as the record in
 * can_bridge/flashing/state.py. Then, for each slot, it has the bytes after the slot's last complete word, because only
 * complete words can be written to a slot.
 */
#include "sw_store.h"

#include "sw_bytes.h"

#define MAGIC 4u
#define SLOT 112u /* number of bytes of a slot in the record before the release's name */
#define REST 7u
#define CRC 4u
#define MOST_BYTES (MAGIC + 2u * (SLOT + SW_NAME_BYTES) + REST + CRC + 2u * SW_FLASH_WORD)

static const uint8_t magic[MAGIC] = {'S', 'W', 'S', '1'};

void sw_state_empty_slot(sw_slot_state *slot)
{
    static const sw_slot_state empty_slot = {0}; /* its phase is SW_PHASE_EMPTY */
    *slot = empty_slot;
}

static void empty(sw_store_state *state)
{
    for (uint32_t i = 0; i < 2u; i++) {
        sw_state_empty_slot(&state->slots[i]);
        state->attempts[i] = 0;
        sw_bytes_fill(state->tail[i], 0xff, SW_FLASH_WORD);
    }
    state->active = SW_NO_SLOT;
    state->least_security_version = 1;
}

static uint32_t encoded(const sw_store_state *state, uint8_t *data)
{
    uint32_t at = MAGIC;
    sw_bytes_copy(data, magic, MAGIC);
    for (uint32_t i = 0; i < 2u; i++) {
        const sw_slot_state *slot = &state->slots[i];
        data[at] = slot->phase;
        data[at + 1u] = slot->boots_left;
        sw_put_big_u32(&data[at + 2u], slot->length);
        sw_put_big_u32(&data[at + 6u], slot->received);
        sw_put_big_u32(&data[at + 10u], slot->facts.security_version);
        sw_bytes_copy(&data[at + 14u], slot->sha256, 32);
        sw_bytes_copy(&data[at + 46u], slot->facts.digest, 32);
        sw_bytes_copy(&data[at + 78u], slot->facts.signer, 32);
        data[at + 110u] = 0;
        data[at + 111u] = slot->facts.name_length;
        sw_bytes_copy(&data[at + SLOT], slot->facts.name, slot->facts.name_length);
        at += SLOT + slot->facts.name_length;
    }
    data[at] = state->active;
    sw_put_big_u32(&data[at + 1u], state->least_security_version);
    sw_bytes_copy(&data[at + 5u], state->attempts, 2);
    at += REST;
    sw_put_big_u32(&data[at], sw_crc32(0, data, at));
    at += CRC;
    for (uint32_t i = 0; i < 2u; i++) sw_bytes_copy(&data[at + i * SW_FLASH_WORD], state->tail[i], SW_FLASH_WORD);
    return at + 2u * SW_FLASH_WORD;
}

/* Returns whether a slot has values that are possible in its phase. */
static int is_sound_slot(const sw_slot_state *slot)
{
    const uint32_t phase = slot->phase;
    const uint32_t most_boots = phase == SW_PHASE_TRIAL ? SW_TRIAL_BOOTS : 0u;
    const int is_filling = phase == SW_PHASE_FILLING;
    const int is_named = slot->facts.name_length > 0u;
    sw_slot_state nameless; /* copy of the slot's state without the facts about its image */
    sw_state_empty_slot(&nameless);
    if (phase != SW_PHASE_EMPTY) {
        if (phase > SW_PHASE_BAD || slot->length == 0u || slot->length > SW_SLOT_BYTES) return 0;
        if (is_filling ? slot->received > slot->length : slot->received != slot->length) return 0;
        nameless.phase = slot->phase;
        nameless.length = slot->length;
        nameless.received = slot->received;
        sw_bytes_copy(nameless.sha256, slot->sha256, 32);
    }
    if (!is_named) return (phase <= SW_PHASE_FILLING || phase == SW_PHASE_BAD) && sw_state_slots_equal(slot, &nameless);
    return phase > SW_PHASE_FILLING && slot->boots_left <= most_boots
           && sw_name_length(slot->facts.name) == slot->facts.name_length;
}

static int is_sound(const sw_store_state *state)
{
    const uint8_t first = state->slots[0].phase;
    if (!is_sound_slot(&state->slots[0]) || !is_sound_slot(&state->slots[1])) return 0;
    if (first == state->slots[1].phase && (first == SW_PHASE_CHECKED || first == SW_PHASE_TRIAL)) return 0;
    if (state->least_security_version == 0u) return 0;
    return state->active == SW_NO_SLOT || (state->active < 2u && state->slots[state->active].phase == SW_PHASE_CONFIRMED);
}

/* Reads a record; returns 0 if it is invalid. Its values are checked, because they decide which image boots. */
static int decoded(const uint8_t *data, uint32_t length, sw_store_state *state)
{
    uint32_t at = MAGIC;
    if (!sw_bytes_equal(data, magic, MAGIC)) return 0;
    for (uint32_t i = 0; i < 2u; i++) {
        sw_slot_state *slot = &state->slots[i];
        slot->phase = data[at];
        slot->boots_left = data[at + 1u];
        slot->length = sw_big_u32(&data[at + 2u]);
        slot->received = sw_big_u32(&data[at + 6u]);
        slot->facts.security_version = sw_big_u32(&data[at + 10u]);
        sw_bytes_copy(slot->sha256, &data[at + 14u], 32);
        sw_bytes_copy(slot->facts.digest, &data[at + 46u], 32);
        sw_bytes_copy(slot->facts.signer, &data[at + 78u], 32);
        const uint32_t name = sw_number(&data[at + 110u], 2);
        at += SLOT;
        if (name > SW_NAME_BYTES) return 0;
        slot->facts.name_length = (uint8_t)name;
        sw_bytes_copy(slot->facts.name, &data[at], name);
        at += name;
    }
    state->active = data[at];
    state->least_security_version = sw_big_u32(&data[at + 1u]);
    sw_bytes_copy(state->attempts, &data[at + 5u], 2);
    at += REST;
    if (sw_big_u32(&data[at]) != sw_crc32(0, data, at)) return 0;
    at += CRC;
    for (uint32_t i = 0; i < 2u; i++) sw_bytes_copy(state->tail[i], &data[at + i * SW_FLASH_WORD], SW_FLASH_WORD);
    return length == at + 2u * SW_FLASH_WORD && is_sound(state);
}

void sw_state_open(sw_store *store)
{
    uint8_t data[MOST_BYTES] = {0};
    const uint32_t length = sw_records_length(&store->records, SW_RECORD_STATE);
    empty(&store->state);
    if (length == 0u || length > MOST_BYTES) return;
    if (sw_records_read(&store->records, SW_RECORD_STATE, 0, data, length) != 0
        || !decoded(data, length, &store->state)) {
        empty(&store->state);
    }
}

sw_store_state *sw_state_draft(sw_store *store)
{
    store->scratch.next.state = store->state;
    return &store->scratch.next.state;
}

int sw_store_has_room(const sw_store *store)
{
    return store->records.limit != (uint8_t)SW_RECORDS_APPEND || sw_records_have_room(&store->records, 2u * MOST_BYTES);
}

int sw_state_keep(sw_store *store, const sw_store_state *next)
{
    uint8_t data[MOST_BYTES];
    if (sw_records_keep(&store->records, SW_RECORD_STATE, data, encoded(next, data)) != 0) return 1;
    if (next != &store->state) store->state = *next;
    return 0;
}

int sw_state_slots_equal(const sw_slot_state *one, const sw_slot_state *other)
{
    uint32_t different = ((uint32_t)one->phase ^ other->phase) | ((uint32_t)one->boots_left ^ other->boots_left);
    different |= (one->length ^ other->length) | (one->received ^ other->received);
    different |= one->facts.security_version ^ other->facts.security_version;
    for (uint32_t i = 0; i < 32u; i++) {
        different |= (uint32_t)one->sha256[i] ^ other->sha256[i];
        different |= (uint32_t)one->facts.digest[i] ^ other->facts.digest[i];
        different |= (uint32_t)one->facts.signer[i] ^ other->facts.signer[i];
    }
    for (uint32_t i = 0; i < SW_NAME_BYTES; i++) different |= (uint32_t)one->facts.name[i] ^ other->facts.name[i];
    return different == 0u;
}

uint32_t sw_state_in_phase(const sw_store_state *state, sw_phase phase)
{
    if (state->slots[0].phase == (uint8_t)phase) return 0;
    return state->slots[1].phase == (uint8_t)phase ? 1u : SW_NO_SLOT;
}

void sw_state_give_up(sw_slot_state *slot)
{
    slot->phase = SW_PHASE_BAD;
    slot->boots_left = 0;
}

/* --- Key list, calibrations, failed attempts and faults; they correspond to can_bridge/flashing/remembered.py --- */

/* The record of calibrations: magic (4 bytes), count (1); for each calibration, digest (32), length (2) and data. */
#define HEAD 5u
#define ENTRY 34u
#define DIGEST 32u

static const uint8_t calibrations_magic[MAGIC] = {'S', 'W', 'C', '1'};

void sw_store_open(sw_store *store, const sw_flash *flash, const sw_rules *rules, sw_store_opens opens)
{
    store->flash = flash;
    store->rules = rules;
    store->opens = opens;
    store->reason = SW_BOOT_NONE;
    store->verdicts[0] = SW_VERDICT_NONE;
    store->verdicts[1] = SW_VERDICT_NONE;
    store->running = SW_NO_SLOT;
    store->verdict = SW_VERDICT_NONE;
    store->wanted = 0;
    store->slot = 0;
    store->at = 0;
    store->until = 0;
    sw_records_open(&store->records, flash);
    sw_store_drop(store);
    sw_records_tidy(&store->records);
    sw_state_open(store);
    const uint32_t length = sw_records_length(&store->records, SW_RECORD_KEYS);
    if (length > SW_KEY_LIST_BYTES || sw_records_read(&store->records, SW_RECORD_KEYS, 0, store->keys, length) != 0
        || !sw_key_list_is_good(store->keys, length, rules->root)) {
        sw_bytes_fill(store->keys, 0, SW_KEY_LIST_BYTES);
    }
}

sw_store_result sw_store_take_keys(sw_store *store, const uint8_t *data, uint32_t length)
{
    const uint32_t needed[2] = {store->state.active, store->running};
    if (!sw_key_list_is_good(data, length, store->rules->root)) return SW_STORE_BAD_KEYS;
    if (sw_key_list_version(data) <= sw_key_list_version(store->keys)) return SW_STORE_BAD_KEYS;
    for (uint32_t i = 0; i < 2u; i++) {
        if (needed[i] == SW_NO_SLOT || store->state.slots[needed[i]].phase != SW_PHASE_CONFIRMED) continue;
        const uint8_t *signer = store->state.slots[needed[i]].facts.signer;
        if (sw_key_is_allowed(store->keys, signer) && !sw_key_is_allowed(data, signer)) return SW_STORE_BAD_KEYS;
    }
    if (sw_records_keep(&store->records, SW_RECORD_KEYS, data, length) != 0) return SW_STORE_BAD_MEMORY;
    sw_bytes_copy(store->keys, data, length);
    return SW_STORE_DONE;
}

static int is_before(const uint8_t one[DIGEST], const uint8_t other[DIGEST])
{
    uint32_t i = 0;
    while (i < DIGEST - 1u && one[i] == other[i]) i++;
    return one[i] < other[i];
}

/* Returns the length of a release's calibration, or 0 without a valid calibration; writes its offset to `place`. */
static uint32_t found(const sw_store *store, const uint8_t digest[DIGEST], uint32_t *place)
{
    uint8_t data[ENTRY], before[DIGEST];
    uint32_t at = HEAD, own = 0;
    if (sw_records_read(&store->records, SW_RECORD_CALIBRATION, 0, data, HEAD) != 0
        || !sw_bytes_equal(data, calibrations_magic, MAGIC)) {
        return 0;
    }
    const uint32_t count = data[MAGIC];
    for (uint32_t i = 0; i < count; i++) {
        if (sw_records_read(&store->records, SW_RECORD_CALIBRATION, at, data, ENTRY) != 0) return 0;
        const uint32_t length = sw_number(&data[DIGEST], 2);
        if (length == 0u || length > SW_MAX_CALIBRATION || (i > 0u && !is_before(before, data))) return 0;
        at += ENTRY;
        if (sw_bytes_equal(data, digest, DIGEST)) {
            *place = at;
            own = length;
        }
        at += length;
        sw_bytes_copy(before, data, DIGEST);
    }
    return at == sw_records_length(&store->records, SW_RECORD_CALIBRATION) ? own : 0u;
}

/* Finds a release's calibration like `found`, but also returns 0 if the calibration cannot be read. */
static uint32_t readable(const sw_store *store, const uint8_t digest[DIGEST], uint32_t *place)
{
    uint8_t data[DIGEST];
    const uint32_t length = found(store, digest, place);
    for (uint32_t at = 0; at < length; at += DIGEST) {
        const uint32_t count = length - at < DIGEST ? length - at : DIGEST;
        if (sw_records_read(&store->records, SW_RECORD_CALIBRATION, *place + at, data, count) != 0) return 0;
    }
    return length;
}

uint32_t sw_store_calibration(const sw_store *store, uint8_t *data, uint32_t room)
{
    uint32_t place = 0;
    if (store->running == SW_NO_SLOT) return 0;
    const uint32_t length = readable(store, store->state.slots[store->running].facts.digest, &place);
    if (length > room) return length;
    return sw_records_read(&store->records, SW_RECORD_CALIBRATION, place, data, length) == 0 ? length : 0u;
}

static void fill_head(uint8_t head[ENTRY], const uint8_t digest[DIGEST], uint32_t length)
{
    sw_bytes_copy(head, digest, DIGEST);
    head[DIGEST] = (uint8_t)(length >> 8);
    head[DIGEST + 1u] = (uint8_t)length;
}

/* Stores the record of calibrations: a calibration for each stored release, with the release's digest. */
sw_store_result sw_store_keep_calibration(sw_store *store, const uint8_t *data, uint32_t length)
{
    uint8_t head[HEAD], own_head[ENTRY], other_head[ENTRY];
    uint32_t place = 0;
    if (store->running == SW_NO_SLOT) return SW_STORE_OUT_OF_ORDER;
    if (length > SW_MAX_CALIBRATION) return SW_STORE_OUT_OF_RANGE;
    const uint8_t *own = store->state.slots[store->running].facts.digest;
    const uint8_t *other = store->state.slots[1u - store->running].facts.digest;
    /* If both slots have the same release, only one calibration is stored for it. */
    const uint32_t kept = sw_bytes_equal(own, other, DIGEST) ? 0u : readable(store, other, &place);
    const uint32_t first = is_before(own, other) ? 1u : 3u;
    sw_part parts[5] = {0};
    parts[0].data = head;
    parts[0].length = HEAD;
    if (length > 0u) {
        parts[first].data = own_head;
        parts[first].length = ENTRY;
        parts[first + 1u].data = data;
        parts[first + 1u].length = length;
    }
    if (kept > 0u) {
        parts[4u - first].data = other_head;
        parts[4u - first].length = ENTRY;
        parts[5u - first].place = place;
        parts[5u - first].length = kept;
    }
    sw_bytes_copy(head, calibrations_magic, MAGIC);
    head[MAGIC] = (uint8_t)((length > 0u ? 1u : 0u) + (kept > 0u ? 1u : 0u));
    fill_head(own_head, own, length);
    fill_head(other_head, other, kept);
    if (sw_records_keep_parts(&store->records, SW_RECORD_CALIBRATION, parts, 5) != 0) return SW_STORE_BAD_MEMORY;
    return SW_STORE_DONE;
}

static uint32_t place_of(uint8_t level) { return level == 0x01u ? 0u : (level == 0x03u ? 1u : 2u); }

uint8_t sw_store_failed_attempts(const sw_store *store, uint8_t level)
{
    const uint32_t place = place_of(level);
    return place < 2u ? store->state.attempts[place] : 0u;
}

sw_store_result sw_store_keep_failed_attempts(sw_store *store, uint8_t level, uint32_t count)
{
    const uint32_t place = place_of(level);
    const uint8_t attempts = (uint8_t)(count < SW_MOST_ATTEMPTS ? count : SW_MOST_ATTEMPTS);
    if (place > 1u) return SW_STORE_OUT_OF_RANGE;
    const uint8_t before = store->state.attempts[place];
    if (attempts == before) return SW_STORE_DONE;
    /* The state is changed directly, because other work may be using the scratch memory. */
    store->state.attempts[place] = attempts;
    if (sw_state_keep(store, &store->state) == 0) return SW_STORE_DONE;
    store->state.attempts[place] = before;
    return SW_STORE_BAD_MEMORY;
}

uint32_t sw_store_faults(const sw_store *store, uint8_t *data, uint32_t room)
{
    const uint32_t length = sw_records_length(&store->records, SW_RECORD_FAULTS);
    if (length > room || sw_records_read(&store->records, SW_RECORD_FAULTS, 0, data, length) != 0) return 0;
    return length;
}

sw_store_result sw_store_keep_faults(sw_store *store, const uint8_t *data, uint32_t length)
{
    if (length > SW_MAX_RECORD) return SW_STORE_OUT_OF_RANGE;
    if (sw_records_keep(&store->records, SW_RECORD_FAULTS, data, length) != 0) return SW_STORE_BAD_MEMORY;
    return SW_STORE_DONE;
}
