/* The releases, the key lists, and the flash memory in which the store is explored; the supply can be cut in it. */
#ifndef STORE_WORLD_H
#define STORE_WORLD_H

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
#define PAYLOAD 32u
#define IMAGE (SW_HEADER_BYTES + PAYLOAD)
#define BLOCK 300u /* bytes of a first block; the second one has the rest */

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

#endif
