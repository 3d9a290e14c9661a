#include "sw_store_parts.h"

#define WORD SW_FLASH_WORD

uint32_t sw_slots_address(uint32_t slot) { return (SW_RECORD_SECTORS + slot * SW_SLOT_SECTORS) * SW_FLASH_SECTOR; }

static int is_blank(const sw_store *store, uint32_t address)
{
    uint8_t data[WORD];
    uint32_t all = 0xffu;
    if (store->flash->read(store->flash->context, address, data, WORD) != 0) return 0;
    for (uint32_t i = 0; i < WORD; i++) all &= data[i];
    return all == 0xffu;
}

uint32_t sw_slots_begin_again(const sw_store *store, uint32_t slot)
{
    const sw_slot_state *standing = &store->state.slots[slot];
    const uint32_t begin = standing->received / WORD * WORD;
    if (standing->received == standing->length) return standing->received;
    for (uint32_t at = begin; at < standing->length; at += WORD) {
        if (!is_blank(store, sw_slots_address(slot) + at)) {
            /* A word is written once: the sector that has one too many is erased. */
            const uint32_t sector = standing->received / SW_FLASH_SECTOR * SW_FLASH_SECTOR;
            return sector > 0u ? sector : SW_NO_OFFSET;
        }
    }
    return standing->received;
}

int sw_slots_erase(sw_store *store, uint32_t slot, uint32_t sector)
{
    return sw_records_begin_erasing(&store->records, SW_RECORD_SECTORS + slot * SW_SLOT_SECTORS + sector);
}

static int written(const sw_store *store, uint32_t address, const uint8_t word[WORD])
{
    uint8_t found[WORD];
    if (store->flash->program(store->flash->context, address, word) != 0) return 1;
    if (store->flash->read(store->flash->context, address, found, WORD) != 0) return 1;
    return !sw_bytes_equal(found, word, WORD);
}

int sw_slots_append(const sw_store *store, uint32_t slot, uint32_t from, uint8_t *tail, const uint8_t *data,
                    uint32_t length)
{
    for (uint32_t at = from; at < from + length; at++) {
        const uint32_t place = at % WORD;
        if (place == 0u) sw_bytes_fill(tail, 0xff, WORD);
        tail[place] = data[at - from];
        if ((place == WORD - 1u || at + 1u == store->state.slots[slot].length)
            && written(store, sw_slots_address(slot) + at - place, tail) != 0) {
            return 1;
        }
    }
    return 0;
}
