/* Key list, calibrations, failed attempts and faults: the twin of can_bridge/flashing/remembered.py. */
#include "sw_store_parts.h"

/* The record of calibrations: magic (4), number (1); of each digest (32), length (2), bytes. */
#define MAGIC 4u
#define HEAD 5u
#define ENTRY 34u
#define DIGEST 32u
#define MOST_BYTES (HEAD + 2u * (ENTRY + SW_MAX_CALIBRATION))

static const uint8_t magic[MAGIC] = {'S', 'W', 'C', '1'};

void sw_store_open(sw_store *store, const sw_flash *flash, const sw_rules *rules)
{
    uint8_t data[SW_KEY_LIST_BYTES];
    store->flash = flash;
    store->rules = rules;
    store->reason = SW_BOOT_NONE;
    store->verdicts[0] = SW_VERDICT_NONE;
    store->verdicts[1] = SW_VERDICT_NONE;
    store->running = SW_NO_SLOT;
    store->verdict = SW_VERDICT_NONE;
    store->wanted = 0;
    store->slot = 0;
    store->at = 0;
    store->until = 0;
    sw_store_drop(store);
    sw_records_open(&store->records, flash);
    sw_records_tidy(&store->records);
    sw_state_open(store);
    store->keys.version = 0;
    store->keys.allowed = 0;
    store->keys.revoked = 0;
    const uint32_t length = sw_records_length(&store->records, SW_RECORD_KEYS);
    if (length <= SW_KEY_LIST_BYTES && sw_records_read(&store->records, SW_RECORD_KEYS, 0, data, length) == 0) {
        (void)sw_key_list_decode(data, length, rules->root, &store->keys);
    }
}

sw_store_result sw_store_take_keys(sw_store *store, const uint8_t *data, uint32_t length)
{
    sw_key_list list = {0};
    const uint32_t needed[2] = {store->state.active, store->running};
    if (!sw_key_list_decode(data, length, store->rules->root, &list)) return SW_STORE_BAD_KEYS;
    if (list.version <= store->keys.version) return SW_STORE_BAD_KEYS;
    for (uint32_t i = 0; i < 2u; i++) {
        if (needed[i] == SW_NO_SLOT || store->state.slots[needed[i]].phase != SW_PHASE_CONFIRMED) continue;
        const uint8_t *signer = store->state.slots[needed[i]].facts.signer;
        if (sw_key_is_allowed(&store->keys, signer) && !sw_key_is_allowed(&list, signer)) return SW_STORE_BAD_KEYS;
    }
    if (sw_records_keep(&store->records, SW_RECORD_KEYS, data, length) != 0) return SW_STORE_BAD_MEMORY;
    store->keys = list;
    return SW_STORE_DONE;
}

/* A release's calibration: its place in the record, and its length; 0: there is none. */
static uint32_t found(const sw_store *store, const uint8_t digest[DIGEST], uint32_t *place)
{
    uint8_t data[ENTRY];
    const uint32_t end = sw_records_length(&store->records, SW_RECORD_CALIBRATION);
    if (sw_records_read(&store->records, SW_RECORD_CALIBRATION, 0, data, HEAD) != 0
        || !sw_bytes_equal(data, magic, MAGIC)) {
        return 0;
    }
    for (uint32_t at = HEAD; at < end;) {
        if (sw_records_read(&store->records, SW_RECORD_CALIBRATION, at, data, ENTRY) != 0) return 0;
        const uint32_t length = ((uint32_t)data[DIGEST] << 8) | data[DIGEST + 1u];
        at += ENTRY;
        if (sw_bytes_equal(data, digest, DIGEST)) {
            *place = at;
            return length <= SW_MAX_CALIBRATION ? length : 0u;
        }
        at += length;
    }
    return 0;
}

static uint32_t calibration_of(const sw_store *store, const uint8_t digest[DIGEST], uint8_t *data)
{
    uint32_t place = 0;
    const uint32_t length = found(store, digest, &place);
    return sw_records_read(&store->records, SW_RECORD_CALIBRATION, place, data, length) == 0 ? length : 0u;
}

uint32_t sw_store_calibration(const sw_store *store, uint8_t *data)
{
    return store->running == SW_NO_SLOT
               ? 0u
               : calibration_of(store, store->state.slots[store->running].facts.digest, data);
}

static uint32_t with_entry(uint8_t *record, uint32_t at, const uint8_t digest[DIGEST], uint32_t length)
{
    record[4]++;
    sw_bytes_copy(&record[at], digest, DIGEST);
    record[at + DIGEST] = (uint8_t)(length >> 8);
    record[at + DIGEST + 1u] = (uint8_t)length;
    return at + ENTRY + length;
}

static int is_before(const uint8_t one[DIGEST], const uint8_t other[DIGEST])
{
    uint32_t i = 0;
    while (i < DIGEST - 1u && one[i] == other[i]) i++;
    return one[i] < other[i];
}

/* In the record stand the calibrations of the releases that are here, by their digests. */
sw_store_result sw_store_keep_calibration(sw_store *store, const uint8_t *data, uint32_t length)
{
    uint8_t record[MOST_BYTES];
    uint32_t at = HEAD;
    if (store->running == SW_NO_SLOT) return SW_STORE_OUT_OF_ORDER;
    if (length > SW_MAX_CALIBRATION) return SW_STORE_OUT_OF_RANGE;
    const uint8_t *own = store->state.slots[store->running].facts.digest;
    const uint8_t *other = store->state.slots[1u - store->running].facts.digest;
    const int is_first = is_before(own, other);
    sw_bytes_copy(record, magic, MAGIC);
    record[MAGIC] = 0;
    for (uint32_t i = 0; i < 2u; i++) {
        if ((i == 0u) == (is_first != 0)) {
            if (length == 0u) continue;
            sw_bytes_copy(&record[at + ENTRY], data, length);
            at = with_entry(record, at, own, length);
        } else if (!sw_bytes_equal(own, other, DIGEST)) {
            const uint32_t kept = calibration_of(store, other, &record[at + ENTRY]);
            if (kept > 0u) at = with_entry(record, at, other, kept);
        } else {
            /* One release in both slots has one calibration. */
        }
    }
    if (sw_records_keep(&store->records, SW_RECORD_CALIBRATION, record, at) != 0) return SW_STORE_BAD_MEMORY;
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
    sw_store_state next = store->state;
    const uint32_t place = place_of(level);
    if (place > 1u) return SW_STORE_OUT_OF_RANGE;
    next.attempts[place] = (uint8_t)(count < SW_MOST_ATTEMPTS ? count : SW_MOST_ATTEMPTS);
    if (next.attempts[place] == store->state.attempts[place]) return SW_STORE_DONE;
    return sw_state_keep(store, &next) == 0 ? SW_STORE_DONE : SW_STORE_BAD_MEMORY;
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
