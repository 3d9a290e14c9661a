#include "sw_records.h"

#include <stddef.h>

#include "sw_bytes.h"

#define WORD SW_FLASH_WORD
#define WORDS (SW_FLASH_SECTOR / WORD)
#define TRIES 3u            /* number of attempts to write a record, each at a new place */
#define FILLED (WORDS / 2u) /* with more words, the other sector is blanked at power-on, and records may move there */

/* The first byte of a word states the word's type; it is 0xFF in a blank word. */
#define IS_SECTOR 0xc3u
#define IS_FIRST 0xa5u
#define IS_FURTHER 0x5au

/* The first word of a record has type, kind, length (2 bytes), CRC-32 of kind, length and data (4 bytes), and data. */
#define KIND 1u
#define LENGTH 2u
#define CRC 4u
#define DATA 8u
#define IN_FIRST (WORD - DATA)
#define IN_FURTHER (WORD - 1u)
/* The first word of a sector has type, magic (3 bytes), sequence number (4 bytes), and the CRC-32 of these 8 bytes. */
#define SEQUENCE 4u
#define SECTOR_CRC 8u

static const uint8_t sector_magic[SEQUENCE] = {IS_SECTOR, 'S', 'W', '1'};

uint32_t sw_crc32(uint32_t before, const uint8_t *data, uint32_t length)
{
    static const uint32_t table[16] = {
        0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u, 0x4db26158u, 0x5005713cu,
        0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu, 0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu,
    };
    uint32_t crc = ~before;
    for (uint32_t i = 0; i < length; i++) {
        crc ^= data[i];
        crc = (crc >> 4) ^ table[crc & 15u];
        crc = (crc >> 4) ^ table[crc & 15u];
    }
    return ~crc;
}

static uint32_t address_of(uint32_t sector, uint32_t word) { return sector * SW_FLASH_SECTOR + word * WORD; }

static int read_word(const sw_records *records, uint32_t sector, uint32_t word, uint8_t data[WORD])
{
    return records->flash->read(records->flash->context, address_of(sector, word), data, WORD);
}

/* Writes a word and reads it back. Returns 1 if the memory fails, or if the word that was read differs. */
static int write_word(const sw_records *records, uint32_t sector, uint32_t word, const uint8_t data[WORD])
{
    uint8_t found[WORD];
    if (records->flash->program(records->flash->context, address_of(sector, word), data) != 0) return 1;
    return read_word(records, sector, word, found) != 0 || !sw_bytes_equal(found, data, WORD);
}

static int is_blank(const uint8_t data[WORD])
{
    uint32_t all = 0xffu;
    for (uint32_t i = 0; i < WORD; i++) all &= data[i];
    return all == 0xffu;
}

static uint32_t words_of(uint32_t length)
{
    return length <= IN_FIRST ? 1u : 1u + (length - IN_FIRST + IN_FURTHER - 1u) / IN_FURTHER;
}

static uint32_t crc_begun(sw_record_kind kind, uint32_t length)
{
    const uint8_t head[3] = {(uint8_t)kind, (uint8_t)(length >> 8), (uint8_t)length};
    return sw_crc32(0, head, 3);
}

/* Return where the data in word `number` of a record begin: the offset in the record's data, and in the word. */
static uint32_t offset_of(uint32_t number) { return number == 0u ? 0u : IN_FIRST + (number - 1u) * IN_FURTHER; }
static uint32_t begin_in(uint32_t number) { return number == 0u ? DATA : 1u; }

static uint32_t lesser(uint32_t one, uint32_t other) { return one < other ? one : other; }

/* Returns whether a complete record begins at a word. */
static int is_record(const sw_records *records, uint32_t word, const uint8_t first[WORD])
{
    const uint32_t kind = first[KIND];
    const uint32_t length = ((uint32_t)first[LENGTH] << 8) | first[LENGTH + 1u];
    const uint32_t count = words_of(length);
    if (first[0] != IS_FIRST || kind == 0u || kind > SW_RECORD_KINDS || length > SW_MAX_RECORD) return 0;
    if (count > WORDS - word) return 0;
    uint32_t crc = sw_crc32(crc_begun((sw_record_kind)kind, length), &first[DATA], lesser(length, IN_FIRST));
    for (uint32_t i = 1; i < count; i++) {
        uint8_t data[WORD];
        if (read_word(records, records->sector, word + i, data) != 0 || data[0] != IS_FURTHER) return 0;
        crc = sw_crc32(crc, &data[1], lesser(length - offset_of(i), IN_FURTHER));
    }
    return crc == sw_big_u32(&first[CRC]);
}

/* Returns whether a sector is valid; stores its sequence number in `sequence`. */
static int is_valid(const sw_records *records, uint32_t sector, uint32_t *sequence)
{
    uint8_t data[WORD];
    if (read_word(records, sector, 0, data) != 0 || !sw_bytes_equal(data, sector_magic, SEQUENCE)) return 0;
    *sequence = sw_big_u32(&data[SEQUENCE]);
    return sw_crc32(0, data, SECTOR_CRC) == sw_big_u32(&data[SECTOR_CRC]);
}

static void scan(sw_records *records)
{
    uint32_t word = 1;
    while (word < WORDS) {
        uint8_t data[WORD];
        const int is_readable = read_word(records, records->sector, word, data) == 0;
        uint32_t count = 1;
        if (is_readable && is_record(records, word, data)) {
            const uint32_t place = (uint32_t)data[KIND] - 1u;
            records->words[place] = word;
            records->lengths[place] = ((uint32_t)data[LENGTH] << 8) | data[LENGTH + 1u];
            count = words_of(records->lengths[place]);
        }
        word += count;
        if (!is_readable || !is_blank(data)) records->end = word;
    }
}

/* Returns whether the sequence number `one` is later than `other`; the largest number is followed by 0. */
static int is_later(uint32_t one, uint32_t other) { return one != other && one - other <= UINT32_MAX / 2u; }

void sw_records_open(sw_records *records, const sw_flash *flash)
{
    records->flash = flash;
    records->limit = SW_RECORDS_WAIT;
    records->is_erasing = 0;
    records->other = SW_OTHER_UNKNOWN;
    records->sector = SW_RECORD_SECTORS;
    records->sequence = 0;
    records->end = 1;
    for (uint32_t i = 0; i < SW_RECORD_KINDS; i++) {
        records->words[i] = 0;
        records->lengths[i] = 0;
    }
    for (uint32_t sector = 0; sector < SW_RECORD_SECTORS; sector++) {
        uint32_t sequence = 0;
        if (is_valid(records, sector, &sequence)
            && (records->sector == SW_RECORD_SECTORS || is_later(sequence, records->sequence))) {
            records->sector = sector;
            records->sequence = sequence;
        }
    }
    if (records->sector < SW_RECORD_SECTORS) scan(records);
}

static int is_blank_sector(const sw_records *records, uint32_t sector)
{
    uint8_t data[WORD];
    uint32_t word = 0;
    while (word < WORDS && read_word(records, sector, word, data) == 0 && is_blank(data)) word++;
    return word == WORDS;
}

static uint32_t other_sector(const sw_records *records) { return records->sector == 0u ? 1u : 0u; }

int sw_records_begin_erasing(sw_records *records, uint32_t sector)
{
    const int failed = records->flash->erase(records->flash->context, sector);
    records->is_erasing = (uint8_t)(failed == 0);
    return failed;
}

sw_flash_state sw_records_erased(sw_records *records)
{
    const sw_flash_state state = records->flash->erased(records->flash->context);
    records->is_erasing = (uint8_t)(state == SW_FLASH_AT_WORK);
    return state;
}

/* Erases a sector that is not blank. Returns 1 if the erasure fails or is not allowed now. */
static int blanked(sw_records *records, uint32_t sector)
{
    sw_flash_state state = SW_FLASH_AT_WORK;
    if (is_blank_sector(records, sector)) return 0;
    if (records->limit != (uint8_t)SW_RECORDS_WAIT || sw_records_begin_erasing(records, sector) != 0) return 1;
    while (state == SW_FLASH_AT_WORK) state = sw_records_erased(records);
    return state != SW_FLASH_DONE;
}

void sw_records_tidy(sw_records *records)
{
    if (records->sector < SW_RECORD_SECTORS && records->end > FILLED) (void)blanked(records, other_sector(records));
}

int sw_records_have_room(const sw_records *records, uint32_t length)
{
    return records->sector < SW_RECORD_SECTORS && words_of(length) <= WORDS - records->end;
}

uint32_t sw_records_length(const sw_records *records, sw_record_kind kind)
{
    return records->lengths[(uint32_t)kind - 1u];
}

int sw_records_read(const sw_records *records, sw_record_kind kind, uint32_t offset, uint8_t *data, uint32_t length)
{
    const uint32_t word = records->words[(uint32_t)kind - 1u];
    const uint32_t end = offset + length;
    if (word == 0u || offset > SW_MAX_RECORD || length > SW_MAX_RECORD || end > sw_records_length(records, kind)) return 1;
    for (uint32_t i = 0; offset_of(i) < end; i++) {
        uint8_t found[WORD];
        const uint32_t last = lesser(offset_of(i + 1u), end);
        if (last <= offset) continue;
        if (read_word(records, records->sector, word + i, found) != 0) return 1;
        for (uint32_t at = offset_of(i) > offset ? offset_of(i) : offset; at < last; at++) {
            data[at - offset] = found[begin_in(i) + at - offset_of(i)];
        }
    }
    return 0;
}

/* A record to write. */
typedef struct {
    sw_record_kind kind;
    const sw_part *parts;
    uint32_t count, length;
} record;

/* Copies bytes of the record from `offset` on. Returns 1 if a stored part cannot be read. */
static int gathered(const sw_records *records, const record *of, uint32_t offset, uint8_t *data, uint32_t length)
{
    uint32_t begin = 0; /* offset of the part's first byte in the record */
    for (uint32_t i = 0; i < of->count; i++) {
        const sw_part *part = &of->parts[i];
        const uint32_t from = begin > offset ? begin : offset;
        const uint32_t to = lesser(begin + part->length, offset + length);
        if (from < to && part->data != NULL) {
            sw_bytes_copy(&data[from - offset], &part->data[from - begin], to - from);
        } else if (from < to
                   && sw_records_read(records, of->kind, part->place + from - begin, &data[from - offset], to - from) != 0) {
            return 1;
        } else {
            /* The part has none of the requested bytes. */
        }
        begin += part->length;
    }
    return 0;
}

static int write_record(const sw_records *records, uint32_t sector, uint32_t word, const record *of)
{
    const uint32_t length = of->length;
    uint8_t found[WORD];
    uint32_t crc = crc_begun(of->kind, length);
    for (uint32_t at = 0; at < length; at += WORD) {
        const uint32_t count = lesser(length - at, WORD);
        if (gathered(records, of, at, found, count) != 0) return 1;
        crc = sw_crc32(crc, found, count);
    }
    for (uint32_t i = 0; i < words_of(length); i++) {
        const uint32_t begin = offset_of(i);
        sw_bytes_fill(found, 0, WORD);
        found[0] = i == 0u ? IS_FIRST : IS_FURTHER;
        if (i == 0u) {
            found[KIND] = (uint8_t)of->kind;
            found[LENGTH] = (uint8_t)(length >> 8);
            found[LENGTH + 1u] = (uint8_t)length;
            sw_put_big_u32(&found[CRC], crc);
        }
        if (gathered(records, of, begin, &found[begin_in(i)], lesser(length - begin, WORD - begin_in(i))) != 0
            || write_word(records, sector, word + i, found) != 0) {
            return 1;
        }
    }
    return 0;
}

/* Copies words to another sector. Returns 1 if a word cannot be read, 2 if a word cannot be written. */
static int copied(const sw_records *records, uint32_t from, uint32_t sector, uint32_t to, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        uint8_t data[WORD];
        if (read_word(records, records->sector, from + i, data) != 0) return 1;
        if (write_word(records, sector, to + i, data) != 0) return 2;
    }
    return 0;
}

/* Moves the newest records into the other sector. The record `of`, if not NULL, replaces the older record of its kind.
 * The first word of the other sector makes this sector valid, and is written last.
 */
static int moved(sw_records *records, const record *of)
{
    const uint32_t own = of == NULL ? SW_RECORD_KINDS : (uint32_t)of->kind - 1u;
    const uint32_t sector = other_sector(records);
    uint8_t head[WORD];
    if (blanked(records, sector) != 0) return 1;
    sw_records next = *records;
    next.sector = sector;
    next.sequence = records->sequence + 1u;
    next.end = 1;
    next.other = SW_OTHER_UNKNOWN;
    for (uint32_t i = 0; i < SW_RECORD_KINDS; i++) {
        const uint32_t count = words_of(records->lengths[i]);
        next.words[i] = 0;
        if (records->words[i] == 0u || i == own) continue;
        const int failed = copied(records, records->words[i], next.sector, next.end, count);
        if (failed == 2) return 1;
        if (failed == 0) {
            next.words[i] = next.end;
        } else {
            next.lengths[i] = 0; /* an unreadable record must not prevent copying the other records */
        }
        next.end += count;
    }
    if (of != NULL) {
        const uint32_t words = words_of(of->length);
        if (words > WORDS - next.end || write_record(records, next.sector, next.end, of) != 0) return 1;
        next.words[own] = next.end;
        next.lengths[own] = of->length;
        next.end += words;
    }
    sw_bytes_fill(head, 0, WORD);
    sw_bytes_copy(head, sector_magic, SEQUENCE);
    sw_put_big_u32(&head[SEQUENCE], next.sequence);
    sw_put_big_u32(&head[SECTOR_CRC], sw_crc32(0, head, SECTOR_CRC));
    if (write_word(records, next.sector, 0, head) != 0) return 1;
    *records = next;
    return 0;
}

/* Returns whether the sector is more than half full, and more than half of its written words are outdated. */
static int is_worth_a_move(const sw_records *records)
{
    uint32_t kept = 1;
    for (uint32_t i = 0; i < SW_RECORD_KINDS; i++) kept += records->words[i] == 0u ? 0u : words_of(records->lengths[i]);
    return records->sector < SW_RECORD_SECTORS && records->end > FILLED && 2u * kept < records->end;
}

void sw_records_care(sw_records *records)
{
    const uint32_t sector = other_sector(records);
    if (records->is_erasing) {
        const sw_flash_state state = sw_records_erased(records);
        if (state == SW_FLASH_DONE) records->other = SW_OTHER_BLANK;
        if (state == SW_FLASH_FAILED) records->other = SW_OTHER_BAD;
    } else if (records->other == (uint8_t)SW_OTHER_UNKNOWN) {
        if (is_blank_sector(records, sector)) {
            records->other = SW_OTHER_BLANK;
        } else if (sw_records_begin_erasing(records, sector) != 0) {
            records->other = SW_OTHER_BAD; /* a failed sector is not erased again */
        } else {
            /* The next call checks the progress of the erasure. */
        }
    } else if (records->other == (uint8_t)SW_OTHER_BLANK && is_worth_a_move(records)) {
        if (moved(records, NULL) != 0) records->other = SW_OTHER_BAD;
    } else {
        /* The other sector is unusable, or a move would not free enough words. */
    }
}

int sw_records_keep(sw_records *records, sw_record_kind kind, const uint8_t *data, uint32_t length)
{
    const sw_part part = {data, 0, length};
    return sw_records_keep_parts(records, kind, &part, 1);
}

int sw_records_keep_parts(sw_records *records, sw_record_kind kind, const sw_part *parts, uint32_t count)
{
    record of = {kind, parts, count, 0};
    for (uint32_t i = 0; i < count; i++) of.length += parts[i].length;
    const uint32_t words = words_of(of.length);
    if (of.length > SW_MAX_RECORD || records->is_erasing) return 1;
    for (uint32_t i = 0; i < TRIES; i++) {
        if (!sw_records_have_room(records, of.length)) {
            if (records->limit == (uint8_t)SW_RECORDS_APPEND) return 1;
            if (moved(records, &of) == 0) return 0;
            records->other = SW_OTHER_UNKNOWN;
        } else {
            const uint32_t word = records->end;
            records->end += words; /* words are not used again, even if the write fails */
            if (write_record(records, records->sector, word, &of) == 0) {
                records->words[(uint32_t)kind - 1u] = word;
                records->lengths[(uint32_t)kind - 1u] = of.length;
                return 0;
            }
        }
    }
    return 1;
}
