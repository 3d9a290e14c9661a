/* What the store remembers of its slots: the record of can_bridge/flashing/state.py, byte by byte, and behind it of each
 * slot the bytes behind its last whole word, which cannot be written yet.
 */
#include "sw_store_parts.h"

#define MAGIC 4u
#define SLOT 112u /* bytes of one, before its name */
#define REST 7u
#define CRC 4u
#define MOST_BYTES (MAGIC + 2u * (SLOT + SW_NAME_BYTES) + REST + CRC + 2u * SW_FLASH_WORD)

static const uint8_t magic[MAGIC] = {'S', 'W', 'S', '1'};

void sw_state_empty_slot(sw_slot_state *slot)
{
    slot->phase = SW_PHASE_EMPTY;
    slot->boots_left = 0;
    slot->length = 0;
    slot->received = 0;
    sw_bytes_fill(slot->sha256, 0, 32);
    slot->facts.security_version = 0;
    slot->facts.name_length = 0;
    sw_bytes_fill(slot->facts.digest, 0, 32);
    sw_bytes_fill(slot->facts.name, 0, SW_NAME_BYTES);
    sw_bytes_fill(slot->facts.signer, 0, 32);
}

void sw_state_empty(sw_store_state *state)
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

/* Of a record that this store wrote, as its CRC says; 0: it is another version's. */
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
        const uint32_t name = data[at + 111u];
        at += SLOT;
        if (name > SW_NAME_BYTES || slot->length > SW_SLOT_BYTES || slot->received > slot->length) return 0;
        slot->facts.name_length = (uint8_t)name;
        sw_bytes_copy(slot->facts.name, &data[at], name);
        at += name;
    }
    state->active = data[at] < 2u ? data[at] : (uint8_t)SW_NO_SLOT;
    state->least_security_version = sw_big_u32(&data[at + 1u]);
    sw_bytes_copy(state->attempts, &data[at + 5u], 2);
    at += REST + CRC;
    for (uint32_t i = 0; i < 2u; i++) sw_bytes_copy(state->tail[i], &data[at + i * SW_FLASH_WORD], SW_FLASH_WORD);
    return length == at + 2u * SW_FLASH_WORD;
}

void sw_state_open(sw_store *store)
{
    uint8_t data[MOST_BYTES] = {0};
    const uint32_t length = sw_records_length(&store->records, SW_RECORD_STATE);
    sw_state_empty(&store->state);
    if (length == 0u || length > MOST_BYTES) return;
    if (sw_records_read(&store->records, SW_RECORD_STATE, 0, data, length) != 0
        || !decoded(data, length, &store->state)) {
        sw_state_empty(&store->state);
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

uint32_t sw_state_next_boot(const sw_store_state *state)
{
    const uint32_t trial = sw_state_in_phase(state, SW_PHASE_TRIAL);
    return trial != SW_NO_SLOT && state->slots[trial].boots_left > 0u ? trial : state->active;
}

void sw_state_give_up(sw_slot_state *slot)
{
    slot->phase = SW_PHASE_BAD;
    slot->boots_left = 0;
}
