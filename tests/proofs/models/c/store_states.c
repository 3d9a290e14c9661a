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
#include "store_world.h"

#define TABLE (1u << 20)
#define KEY_WORDS 6u   /* words of the key list's record, */
#define STATE_WORDS 10u /* and of the state's: so many, or one more */

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

/* --- Steps --- */

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

#include "store_rules.h"

#include "store_calls.h"

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
