/* The store over a flash memory that is played here: words are written once, and the supply may go in any operation. */
#include "sw_bytes.h"
#include "sw_store.h"

#define WORDS (SW_FLASH_BYTES / SW_FLASH_WORD)
#define NEVER UINT64_MAX

typedef struct {
    sw_store store;
    sw_flash flash;
    sw_rules rules;
    uint8_t memory[SW_FLASH_BYTES];
    uint8_t unreadable[WORDS];
    uint64_t operations, cut_at, worn_at, records_left, random;
    uint32_t twice; /* words that were programmed without being erased, or outside */
    uint32_t slow, looks; /* at an erasure until it has ended: of each, and of the one at work */
    uint8_t is_off, breaks; /* breaks: 1: no erasure begins; 2: each fails */
} twin;

static uint32_t drawn(twin *one, uint32_t below)
{
    one->random = one->random * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(one->random >> 33) % below;
}

static int is_blank(const twin *one, uint32_t word)
{
    uint32_t all = one->unreadable[word] ? 0u : 0xffu;
    for (uint32_t i = 0; i < SW_FLASH_WORD; i++) all &= one->memory[word * SW_FLASH_WORD + i];
    return all == 0xffu;
}

/* What a cut leaves of a word that was being written: nothing, a prefix of its bits, all of it, or no readable word. */
static void tear_word(twin *one, uint32_t word, const uint8_t *data)
{
    const uint32_t kind = drawn(one, 4);
    const uint32_t bits = kind == 0u ? 0u : (kind == 1u ? 8u * SW_FLASH_WORD : drawn(one, 8u * SW_FLASH_WORD));
    for (uint32_t i = 0; i < bits; i++) {
        if (((uint32_t)data[i / 8u] >> (i % 8u) & 1u) == 0u) {
            uint8_t *byte = &one->memory[word * SW_FLASH_WORD + i / 8u];
            *byte = (uint8_t)((uint32_t)*byte & ~(1u << (i % 8u)));
        }
    }
    one->unreadable[word] = kind == 3u;
}

/* What a cut leaves of a sector that was being erased: each word as it was, blank, any value, or not readable. */
static void tear_sector(twin *one, uint32_t sector)
{
    const uint32_t most = drawn(one, 4);
    for (uint32_t i = 0; i < SW_FLASH_SECTOR / SW_FLASH_WORD; i++) {
        const uint32_t word = sector * (SW_FLASH_SECTOR / SW_FLASH_WORD) + i;
        const uint32_t kind = drawn(one, 4) == 0u ? drawn(one, 4) : most;
        for (uint32_t k = 0; kind > 0u && k < SW_FLASH_WORD; k++) {
            one->memory[word * SW_FLASH_WORD + k] = kind == 1u ? 0xffu : (uint8_t)drawn(one, 256);
        }
        if (kind > 0u) one->unreadable[word] = kind == 3u;
    }
}

static int erase(void *context, uint32_t sector)
{
    twin *one = context;
    if (one->is_off || one->breaks == 1u || sector >= SW_FLASH_BYTES / SW_FLASH_SECTOR) return 1;
    one->looks = one->slow;
    if (one->operations++ == one->cut_at) {
        tear_sector(one, sector);
        one->is_off = 1;
        return 1;
    }
    sw_bytes_fill(&one->memory[sector * SW_FLASH_SECTOR], 0xff, SW_FLASH_SECTOR);
    sw_bytes_fill(&one->unreadable[sector * (SW_FLASH_SECTOR / SW_FLASH_WORD)], 0, SW_FLASH_SECTOR / SW_FLASH_WORD);
    return 0;
}

static sw_flash_state erased(void *context)
{
    twin *one = context;
    if (one->is_off || one->breaks == 2u) return SW_FLASH_FAILED;
    if (one->looks == 0u) return SW_FLASH_DONE;
    one->looks--;
    return SW_FLASH_AT_WORK;
}

static int program(void *context, uint32_t address, const uint8_t *data)
{
    twin *one = context;
    const uint32_t word = address / SW_FLASH_WORD;
    if (one->is_off) return 1;
    if (address % SW_FLASH_WORD != 0u || word >= WORDS || !is_blank(one, word)) {
        one->twice++;
        return 1;
    }
    if (address < SW_RECORD_SECTORS * SW_FLASH_SECTOR && data[0] == 0xa5u) {
        if (one->records_left == 0u) return 1;
        one->records_left--;
    }
    const uint64_t number = one->operations++;
    if (number == one->cut_at) {
        tear_word(one, word, data);
        one->is_off = 1;
        return 1;
    }
    if (number == one->worn_at) {
        tear_word(one, word, data);
        if (sw_bytes_equal(&one->memory[address], data, SW_FLASH_WORD)) one->unreadable[word] = 1;
        return (int)drawn(one, 2); /* the memory notices it, or whoever reads it back */
    }
    sw_bytes_copy(&one->memory[address], data, SW_FLASH_WORD);
    return 0;
}

static int read(void *context, uint32_t address, uint8_t *data, uint32_t length)
{
    const twin *one = context;
    uint32_t failed = one->is_off || length > SW_FLASH_BYTES || address > SW_FLASH_BYTES - length;
    if (failed) return 1;
    for (uint32_t i = 0; i < length; i++) {
        data[i] = one->memory[address + i];
        failed |= one->unreadable[(address + i) / SW_FLASH_WORD];
    }
    return (int)failed;
}

/* As in node_twin.py; it is read where it stands. */
static int opens(const uint8_t *image) { return image[SW_HEADER_BYTES] != 0xffu; }

uint32_t twin_bytes(void) { return (uint32_t)sizeof(twin); }

void twin_erased(twin *one, const uint8_t *rules)
{
    sw_bytes_fill((uint8_t *)one, 0, (uint32_t)sizeof(twin));
    sw_bytes_fill(one->memory, 0xff, SW_FLASH_BYTES);
    one->records_left = NEVER;
    sw_bytes_copy((uint8_t *)&one->rules, rules, (uint32_t)sizeof(sw_rules));
}

/* The supply comes, and goes in the operation with this number from now on. */
void twin_power_on(twin *one, uint64_t cut_at, uint64_t seed)
{
    const sw_flash flash = {one, one->memory, erase, erased, program, read};
    sw_bytes_fill((uint8_t *)&one->store, 0xa5, (uint32_t)sizeof(sw_store)); /* RAM has any value */
    one->flash = flash;
    one->operations = 0;
    one->cut_at = cut_at;
    one->worn_at = NEVER;
    one->random = seed;
    one->is_off = 0;
    sw_store_open(&one->store, &one->flash, &one->rules, opens);
}

/* The word of the operation with this number is worn. */
void twin_wear(twin *one, uint64_t number) { one->worn_at = number; }

/* So many records are written, and then none. */
void twin_fail(twin *one, uint64_t records) { one->records_left = records; }

/* Erasures take so many looks, and fail in this way. */
void twin_erases(twin *one, uint32_t slow, uint8_t breaks)
{
    one->slow = slow;
    one->breaks = breaks;
}

void twin_limit(twin *one, uint8_t limit) { one->store.records.limit = limit; }

sw_store *twin_store(twin *one) { return &one->store; }
sw_records *twin_records(twin *one) { return &one->store.records; }
const uint8_t *twin_memory(const twin *one) { return one->memory; }
const uint8_t *twin_unreadable(const twin *one) { return one->unreadable; }
uint64_t twin_operations(const twin *one) { return one->operations; }
uint32_t twin_twice(const twin *one) { return one->twice; }
uint8_t twin_is_off(const twin *one) { return one->is_off; }
uint32_t twin_wanted(const twin *one) { return one->store.wanted; }
uint8_t twin_verdict(const twin *one) { return one->store.verdict; }
const uint8_t *twin_tail(const twin *one, uint32_t slot) { return one->store.state.tail[slot]; }

/* Checks of one image by itself. */
uint32_t twin_judge(const uint8_t *image, uint32_t length, const uint8_t *keys, uint32_t keys_length,
                    const uint8_t *rules, uint32_t least)
{
    sw_rules own;
    sw_sha256 hash;
    uint8_t header[SW_HEADER_BYTES] = {0}, payload[32];
    sw_bytes_copy((uint8_t *)&own, rules, (uint32_t)sizeof(own));
    const uint8_t none[SW_KEY_LIST_BYTES] = {0};
    const uint8_t *list = sw_key_list_is_good(keys, keys_length, own.root) ? keys : none;
    sw_bytes_copy(header, image, length < SW_HEADER_BYTES ? length : SW_HEADER_BYTES);
    sw_sha256_begin(&hash);
    if (length > SW_HEADER_BYTES) sw_sha256_add(&hash, &image[SW_HEADER_BYTES], length - SW_HEADER_BYTES);
    sw_sha256_end(&hash, payload);
    return (uint32_t)sw_release_judge(header, length, payload, list, &own, least);
}

uint32_t twin_keys_version(const uint8_t *data, uint32_t length, const uint8_t *root)
{
    return sw_key_list_is_good(data, length, root) ? sw_key_list_version(data) : 0u;
}

#ifdef TWIN_COVERAGE
void __gcov_dump(void);
void twin_dump(void) { __gcov_dump(); }
#endif

void twin_sha256(const uint8_t *data, uint32_t length, uint32_t first, uint8_t *digest)
{
    sw_sha256 hash;
    sw_sha256_begin(&hash);
    sw_sha256_add(&hash, data, first);
    sw_sha256_add(&hash, &data[first], length - first);
    sw_sha256_end(&hash, digest);
}

#ifdef TWIN_FUZZ
/* Images from stdin through a store: rules, a key list with its length, then images with length and SHA-256; a byte for
 * each comes back, its verdict, or 0x80 and why it was not taken.
 */
#include <stdio.h>

static twin one;
static uint8_t data[1u << 20];

static uint32_t taken(uint32_t length) { return (uint32_t)fread(data, 1, length, stdin); }

static uint32_t number(void)
{
    uint8_t found[4];
    return fread(found, 1, 4, stdin) == 4u ? sw_big_u32(found) : 0xffffffffu;
}

int main(void)
{
    if (taken((uint32_t)sizeof(sw_rules)) != sizeof(sw_rules)) return 2;
    twin_erased(&one, data);
    twin_power_on(&one, NEVER, 0);
    if (sw_store_take_keys(&one.store, data, taken(number())) != SW_STORE_DONE) return 3;
    for (uint32_t length = number(); length != 0xffffffffu; length = number()) {
        uint8_t sha256[32];
        sw_store_result result;
        if (fread(sha256, 1, 32, stdin) != 32u || length > sizeof(data) || taken(length) != length) return 4;
        result = sw_store_announce(&one.store, length, sha256);
        while (result == SW_STORE_MORE) result = sw_store_go_on(&one.store);
        if (result == SW_STORE_DONE) {
            const uint32_t wanted = one.store.wanted; /* all of it is there if the same one came before */
            result = sw_store_append(&one.store, &data[wanted], length - wanted);
            while (result == SW_STORE_MORE) result = sw_store_go_on(&one.store);
        }
        if (result == SW_STORE_DONE) result = sw_store_finish(&one.store);
        while (result == SW_STORE_MORE) result = sw_store_go_on(&one.store);
        (void)putchar(result == SW_STORE_DONE ? (int)one.store.verdict : (int)(0x80u | (uint32_t)result));
    }
    return one.twice > 0u ? 5 : 0;
}
#endif
