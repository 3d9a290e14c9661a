/* Explores the store's states: every call from every state, with the supply cut in every operation of the flash memory
 * and again in every operation of each recovery, until no new state appears. The code is the store's own; only the flash
 * memory is played, and a signature is a keyed hash.
 *
 *     store_states MOST
 *
 * Two states are one if the store cannot tell them apart: the records that count, the room behind them, what the other
 * sector of records is, the bytes of each slot that count and whether the others are blank, and what is in memory. At
 * most MOST states are explored. Prints what was counted, a name and a number a line. Ends with 1 at the first state or
 * step that is not allowed, and the steps that lead to it.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sw_bytes.h"
#include "sw_store.h"

#define WORD SW_FLASH_WORD
#define SECTOR_WORDS (SW_FLASH_SECTOR / WORD)
#define SECTORS (SW_RECORD_SECTORS + 2u * SW_SLOT_SECTORS)
#define WORDS (SECTORS * SECTOR_WORDS)
#define NEVER UINT32_MAX
#define TEARS 4u   /* ways in which a cut leaves a word or a sector: */
#define BEFORE 0u  /* as it was, */
#define HALF 1u    /* half done, */
#define SPOILED 2u /* not readable, */
#define AFTER 3u   /* or done, which is as BEFORE in the next operation */
#define TABLE (1u << 20)
#define PAYLOAD 32u
#define IMAGE (SW_HEADER_BYTES + PAYLOAD)
#define BLOCK 300u /* bytes of a first block; the second one has the rest */
#define KEY_WORDS 6u   /* words of the key list's record, */
#define STATE_WORDS 10u /* and of the state's: so many, or one more */

/* --- Releases and key lists --- */

/* `next` is sent only to see whether a release can still be flashed. */
enum { OLD, NEW, FOREIGN, NEXT, IMAGES };
static const struct {
    char name;
    uint8_t version, key;
} made[IMAGES] = {{'o', 1, 0}, {'n', 2, 1}, {'f', 3, 2}, {'x', 3, 0}};
static uint8_t images[IMAGES][IMAGE], hashes[IMAGES][32];
static uint8_t lists[2][48 + 2 * 32 + 64]; /* keys 0 and 1 may sign; then key 1 is revoked */
static sw_rules rules;

static void key_of(uint32_t number, uint8_t key[32]) { memset(key, (int)(0x10u + number), 32); }

static void sign(const uint8_t key[32], const uint8_t *data, uint32_t length, uint8_t signature[64])
{
    sw_sha256 hash;
    sw_sha256_begin(&hash);
    sw_sha256_add(&hash, key, 32);
    sw_sha256_add(&hash, data, length);
    memset(signature, 0, 64);
    sw_sha256_end(&hash, signature);
}

int sw_signature_is_good(const uint8_t signature[64], const uint8_t key[32], const uint8_t *data, uint32_t length)
{
    uint8_t own[64];
    sign(key, data, length, own);
    return memcmp(own, signature, 64) == 0;
}

int sw_key_is_weak(const uint8_t key[32])
{
    (void)key;
    return 0;
}

static void make_image(uint32_t which)
{
    uint8_t *image = images[which];
    memcpy(image, "SWCTRL01", 8);
    image[8] = IMAGE & 0xffu;
    image[9] = IMAGE >> 8;
    image[13] = SW_HEADER_BYTES >> 8;
    memset(&image[SW_HEADER_BYTES], 'a' + (int)which, PAYLOAD);
    sw_sha256_of(&image[SW_HEADER_BYTES], PAYLOAD, &image[16]);
    memset(&image[112], 1 + (int)which, 32);
    image[144] = made[which].version;
    image[256] = (uint8_t)made[which].name;
    key_of(made[which].key, &image[416]);
    sign(&image[416], image, 448, &image[448]);
    sw_sha256_of(image, IMAGE, hashes[which]);
}

static void make_list(uint32_t which)
{
    uint8_t *list = lists[which];
    memcpy(list, "SWKEYS01", 8);
    list[11] = (uint8_t)(which + 1u);
    list[12] = which == 0u ? 2 : 1;
    list[13] = which == 0u ? 0 : 1;
    key_of(9, rules.root);
    key_of(9, &list[16]);
    key_of(0, &list[48]);
    key_of(1, &list[80]);
    sign(rules.root, list, 112, &list[112]);
}

static int opens(const uint8_t *image) { return image[SW_HEADER_BYTES] != 0xffu; }

/* --- The world: flash memory, and the store in memory --- */

typedef struct {
    uint8_t memory[SW_FLASH_BYTES];
    uint8_t unreadable[WORDS];
    sw_store store;
    uint8_t powered;
} world_state;

static world_state now;
static uint32_t operations, cut_at, tear;

static int goes_off(void)
{
    const int cut = operations++ == cut_at;
    if (cut) now.powered = 0;
    return cut;
}

static int is_blank(uint32_t word)
{
    uint32_t all = now.unreadable[word] ? 0u : 0xffu;
    for (uint32_t i = 0; i < WORD; i++) all &= now.memory[word * WORD + i];
    return all == 0xffu;
}

static void fail(const char *why);

static int erase(void *context, uint32_t sector)
{
    (void)context;
    if (!now.powered) return 1;
    const uint32_t cut = (uint32_t)goes_off();
    for (uint32_t i = 0; i < SECTOR_WORDS; i++) {
        const uint32_t word = sector * SECTOR_WORDS + i;
        if (cut && (tear == BEFORE || (tear == HALF && i >= SECTOR_WORDS / 2u))) continue;
        memset(&now.memory[word * WORD], cut && tear == SPOILED ? 0 : 0xff, WORD);
        now.unreadable[word] = cut && tear == SPOILED;
    }
    return (int)cut;
}

static sw_flash_state erased(void *context)
{
    (void)context;
    return now.powered ? SW_FLASH_DONE : SW_FLASH_FAILED;
}

static int program(void *context, uint32_t address, const uint8_t *word)
{
    static const uint32_t bytes[TEARS] = {0, WORD / 2u, WORD, WORD};
    (void)context;
    if (!now.powered) return 1;
    if (address % WORD != 0u || !is_blank(address / WORD)) fail("a word is written twice");
    const uint32_t cut = (uint32_t)goes_off();
    memcpy(&now.memory[address], word, cut ? bytes[tear] : WORD);
    now.unreadable[address / WORD] = cut && tear == SPOILED;
    return (int)cut;
}

static int read_flash(void *context, uint32_t address, uint8_t *data, uint32_t length)
{
    uint32_t failed = !now.powered || length > SW_FLASH_BYTES || address > SW_FLASH_BYTES - length;
    (void)context;
    if (failed) return 1;
    memcpy(data, &now.memory[address], length);
    for (uint32_t i = address / WORD; i * WORD < address + length; i++) failed |= now.unreadable[i];
    return (int)failed;
}

static const sw_flash flash = {NULL, now.memory, erase, erased, program, read_flash};

/* --- States --- */

typedef struct {
    uint8_t powered, running, announced, verdicts[2], reason, other;
} memory_facts;

typedef struct {
    uint32_t sectors[SECTORS]; /* numbers of their contents */
    uint32_t parent;
    uint8_t call, piece, tear, cut;
    memory_facts facts;
} state;

typedef struct {
    uint8_t bytes[SW_FLASH_SECTOR], unreadable[SECTOR_WORDS];
} content;

typedef struct {
    uint64_t key[2];
    uint32_t number; /* 0: free */
} place;

static place seen[TABLE], known[TABLE];
static state *states;
static content *contents;
static uint32_t state_count, content_count, state_room, content_room;
static uint32_t transitions, cuts, second_cuts, boots, trials, recoveries;

static void mix(uint64_t key[2], const void *data, size_t length)
{
    const uint8_t *bytes = data;
    for (size_t i = 0; i < length; i++) {
        key[0] = (key[0] ^ bytes[i]) * 0x100000001b3u;
        key[1] = ((key[1] << 7 | key[1] >> 57) + bytes[i]) * 0x9e3779b97f4a7c15u;
    }
}

/* Returns the place of a key, which is free if the key is new. */
static place *find(place *table, const uint64_t key[2])
{
    uint32_t at = (uint32_t)(key[0] >> 20 ^ key[1]) % TABLE;
    if (state_count + content_count > TABLE / 2u) exit(2);
    while (table[at].number != 0u && (table[at].key[0] != key[0] || table[at].key[1] != key[1])) at = (at + 1u) % TABLE;
    table[at].key[0] = key[0];
    table[at].key[1] = key[1];
    return &table[at];
}

static void *grown(void *all, uint32_t count, uint32_t *room, size_t size)
{
    if (count < *room) return all;
    *room = *room == 0u ? 1024u : 2u * *room;
    void *more = realloc(all, *room * size);
    if (more == NULL) exit(2);
    return more;
}

static uint32_t number_of_sector(uint32_t sector)
{
    uint64_t key[2] = {0xcbf29ce484222325u, 1};
    const uint8_t *bytes = &now.memory[sector * SW_FLASH_SECTOR];
    const uint8_t *unreadable = &now.unreadable[sector * SECTOR_WORDS];
    mix(key, bytes, SW_FLASH_SECTOR);
    mix(key, unreadable, SECTOR_WORDS);
    place *found = find(known, key);
    if (found->number == 0u) {
        contents = grown(contents, content_count + 1u, &content_room, sizeof *contents);
        found->number = ++content_count;
        memcpy(contents[content_count - 1u].bytes, bytes, SW_FLASH_SECTOR);
        memcpy(contents[content_count - 1u].unreadable, unreadable, SECTOR_WORDS);
    }
    return found->number - 1u;
}

static memory_facts facts_of(void)
{
    const sw_store *store = &now.store;
    const memory_facts facts = {now.powered, store->running, store->announced, {store->verdicts[0], store->verdicts[1]},
                                store->reason, store->records.other};
    const memory_facts off = {0};
    return now.powered ? facts : off;
}

/* Puts the store into memory as the records have it, with these facts besides. */
static void found_in_flash(const memory_facts *facts)
{
    sw_store *store = &now.store;
    now.powered = 1;
    memset(store, 0, sizeof *store);
    store->flash = &flash;
    store->rules = &rules;
    store->opens = opens;
    sw_records_open(&store->records, &flash);
    sw_state_open(store);
    const uint32_t length = sw_records_length(&store->records, SW_RECORD_KEYS);
    (void)sw_records_read(&store->records, SW_RECORD_KEYS, 0, store->keys, length);
    store->records.limit = SW_RECORDS_MOVE;
    store->records.other = facts->other;
    store->running = facts->powered ? facts->running : SW_NO_SLOT;
    store->announced = facts->powered ? facts->announced : SW_NO_SLOT;
    memcpy(store->verdicts, facts->verdicts, 2);
    store->reason = facts->reason;
}

static void load(uint32_t number)
{
    const state *one = &states[number];
    for (uint32_t i = 0; i < SECTORS; i++) {
        memcpy(&now.memory[i * SW_FLASH_SECTOR], contents[one->sectors[i]].bytes, SW_FLASH_SECTOR);
        memcpy(&now.unreadable[i * SECTOR_WORDS], contents[one->sectors[i]].unreadable, SECTOR_WORDS);
    }
    cut_at = NEVER;
    found_in_flash(&one->facts);
    now.powered = one->facts.powered;
}

static uint32_t kind_of_sector(uint32_t sector)
{
    uint32_t word = 0;
    while (word < SECTOR_WORDS && is_blank(sector * SECTOR_WORDS + word)) word++;
    if (word == SECTOR_WORDS) return 0;
    return now.memory[sector * SW_FLASH_SECTOR] == 0xc3u && !now.unreadable[sector * SECTOR_WORDS] ? 1u : 2u;
}

/* How much fits behind the records: places between which no record's size lies are one. */
static uint32_t room_behind(const sw_records *records)
{
    const uint32_t left = SECTOR_WORDS - records->end;
    if (left < KEY_WORDS) return 0;
    if (left < STATE_WORDS) return KEY_WORDS;
    return left > STATE_WORDS && left <= STATE_WORDS + 3u ? STATE_WORDS + 1u : left;
}

/* All that the store can tell, as it is in the flash and in memory now. */
static void key_now(uint64_t key[2], const memory_facts *facts)
{
    const sw_records *records = &now.store.records;
    uint8_t record[SW_FLASH_SECTOR];
    const uint32_t length = sw_records_length(records, SW_RECORD_STATE);
    const uint32_t behind[4] = {room_behind(records), records->end > SECTOR_WORDS / 2u,
                                kind_of_sector(1u - records->sector % 2u), sw_key_list_version(now.store.keys)};
    key[0] = 0xcbf29ce484222325u;
    key[1] = 2;
    (void)sw_records_read(records, SW_RECORD_STATE, 0, record, length);
    mix(key, facts, sizeof *facts);
    mix(key, behind, sizeof behind);
    mix(key, record, length);
    for (uint32_t i = 0; i < 2u; i++) {
        const sw_slot_state *slot = &now.store.state.slots[i];
        const uint32_t first = sw_slots_address(i) / WORD;
        const uint32_t whole = slot->received == slot->length ? slot->received : slot->received / WORD * WORD;
        uint8_t rest = 0;
        mix(key, &now.memory[first * WORD], whole);
        mix(key, &now.unreadable[first], whole / WORD);
        for (uint32_t at = whole; at < slot->length; at += WORD) rest |= (uint8_t)!is_blank(first + at / WORD);
        mix(key, &rest, 1);
    }
}

/* --- What is allowed --- */

enum { POWER, ANNOUNCE, APPEND = ANNOUNCE + NEXT, SPOILT, FINISH, ACTIVATE, CONFIRM, REVERT, DROP, OLD_KEYS, KEYS, CARE, CALLS };
static const char *const names[CALLS] = {"power", "announce old", "announce new", "announce foreign", "append",
                                         "append spoilt bytes", "finish", "activate", "confirm", "revert", "drop",
                                         "take old keys", "take keys", "care"};
static uint32_t from, call_now; /* the step under way */
static uint8_t piece_now;

static void tell(uint32_t number)
{
    if (number >= state_count || states[number].parent == number) return;
    const state *one = &states[number];
    tell(one->parent);
    printf("%s", names[one->call]);
    if (one->piece != 0xffu) printf(", left after piece %u", one->piece);
    if (one->tear != 0xffu) printf(", cut in operation %u, torn %u", one->cut, one->tear);
    printf("\n");
}

static void fail(const char *why)
{
    tell(from);
    printf("%s (cut %d, torn %u): %s\n", names[call_now], cut_at == NEVER ? -1 : (int)cut_at, tear, why);
    exit(1);
}

static void must(int holds, const char *why)
{
    if (!holds) fail(why);
}

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

/* --- Calls --- */

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

/* --- The exploration --- */

/* Takes in the present state; at a cut what the flash has then, without power. Returns whether it is new. */
static int arrive(const world_state *was)
{
    uint64_t key[2];
    const memory_facts facts = facts_of();
    transitions++;
    if (facts.powered) judge_memory(); /* and thereby puts the store into memory anew */
    if (!facts.powered) found_in_flash(&facts);
    judge_step(was);
    if (facts.powered) {
        if (call_now == POWER) judge_boot(was);
        judge_running();
    }
    key_now(key, &facts);
    place *found = find(seen, key);
    now.powered = facts.powered;
    if (found->number != 0u) return 0;
    states = grown(states, state_count + 1u, &state_room, sizeof *states);
    state *one = &states[state_count];
    memset(one, 0, sizeof *one);
    for (uint32_t i = 0; i < SECTORS; i++) one->sectors[i] = number_of_sector(i);
    one->parent = from;
    one->call = (uint8_t)call_now;
    one->piece = piece_now;
    one->cut = (uint8_t)cut_at;
    one->tear = cut_at == NEVER ? 0xffu : (uint8_t)tear;
    one->facts = facts;
    found->number = ++state_count;
    return 1;
}

/* One call from a state: to its end, left after each piece, and cut in each operation in each way. */
static void follow(uint32_t call)
{
    static world_state was;
    call_now = call;
    piece_now = 0xff;
    cut_at = NEVER;
    load(from);
    const int is_recovery = !now.powered;
    was = now;
    operations = 0;
    const uint32_t pieces = perform(call);
    const uint32_t count = operations;
    (void)arrive(&was);
    for (piece_now = 0; piece_now < pieces; piece_now++) {
        now = was;
        (void)perform(call);
        (void)arrive(&was);
    }
    piece_now = 0xff;
    for (uint32_t at = 0; at < count; at++) {
        for (tear = BEFORE; tear < (at + 1u < count ? AFTER : TEARS); tear++) {
            now = was;
            operations = 0;
            cut_at = at;
            (void)perform(call);
            must(!now.powered, "the supply did not go");
            cuts++;
            second_cuts += (uint32_t)is_recovery;
            (void)arrive(&was);
        }
    }
    cut_at = NEVER;
}

/* A state from which all others follow. */
static void start(void)
{
    const world_state first = now;
    call_now = DROP;
    from = state_count;
    (void)arrive(&first);
}

static void begin(void)
{
    for (uint32_t i = 0; i < IMAGES; i++) make_image(i);
    for (uint32_t i = 0; i < 2u; i++) make_list(i);
    memset(now.memory, 0xff, sizeof now.memory);
    piece_now = 0xff;
    cut_at = NEVER;
    power_on();
    const int listed = sw_store_take_keys(&now.store, lists[0], (uint32_t)sizeof lists[0]) == SW_STORE_DONE;
    must(listed && is_flashed(OLD), "production fails");
    /* The numbers of the sectors begin again soon. */
    uint8_t *head = &now.memory[now.store.records.sector * SW_FLASH_SECTOR];
    sw_put_big_u32(&head[4], UINT32_MAX - 1u);
    sw_put_big_u32(&head[8], sw_crc32(0, head, 8));
    power_on();
    start();
    /* So that what follows an update is near as well. */
    must(is_on_trial(NEW), "an update fails");
    start();
    must(sw_store_confirm(cared()) == SW_STORE_DONE, "an update is not confirmed");
    start();
}

int main(int argc, char **argv)
{
    if (argc != 2) return 2;
    const uint32_t most = (uint32_t)strtoul(argv[1], NULL, 10);
    begin();
    uint32_t depth = 0, ends = state_count;
    for (from = 0; from < state_count && from < most; from++) {
        if (from == ends) {
            depth++;
            ends = state_count;
        }
        if (from % 1000u == 0u) fprintf(stderr, "%u of %u states\n", from, state_count);
        if (states[from].facts.powered) {
            load(from);
            call_now = POWER;
            judge_recovery();
            for (uint32_t call = 0; call < CALLS; call++) follow(call);
        } else {
            follow(POWER);
        }
    }
    printf("states %u\nexplored %u\ndepth %u\ntransitions %u\ncuts %u\nsecond_cuts %u\nboots %u\ntrials %u\nrecoveries %u\n",
           state_count, from, depth, transitions, cuts, second_cuts, boots, trials, recoveries);
    return 0;
}
