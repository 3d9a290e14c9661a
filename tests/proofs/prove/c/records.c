/* Records over a flash memory of any content, of which any word may be unreadable and any operation fail. */
#include "bytes_model.h"

#include "sw_records.c"

typedef struct {
    uint8_t bytes[WORD];
} any_word;

static int read_any(void *context, uint32_t address, uint8_t *data, uint32_t length)
{
    any_word any;
    (void)context;
    PROVE(length == WORD && address % WORD == 0u && address + WORD <= SW_RECORD_SECTORS * SW_FLASH_SECTOR);
    *(any_word *)data = any;
    return nondet_int();
}

static int program_any(void *context, uint32_t address, const uint8_t *word)
{
    (void)context;
    (void)touch(word, WORD);
    PROVE(address % WORD == 0u && address + WORD <= SW_RECORD_SECTORS * SW_FLASH_SECTOR); /* never a slot */
    return nondet_int();
}

static int erase_any(void *context, uint32_t sector)
{
    (void)context;
    PROVE(sector < SW_RECORD_SECTORS);
    return nondet_int();
}

static sw_flash_state erased_any(void *context)
{
    (void)context;
    return nondet_int() ? SW_FLASH_DONE : SW_FLASH_FAILED; /* how long it takes is no matter of the records */
}

static const sw_flash flash = {NULL, NULL, erase_any, erased_any, program_any, read_any};

static int is_sound(const sw_records *records)
{
    int sound = records->sector <= SW_RECORD_SECTORS && records->end >= 1u && records->end <= WORDS;
    sound &= records->limit <= SW_RECORDS_APPEND && records->other <= SW_OTHER_BAD;
    for (uint32_t i = 0; i < SW_RECORD_KINDS; i++) {
        const uint32_t length = records->lengths[i], word = records->words[i];
        sound &= length <= SW_MAX_RECORD && word < WORDS;
        sound &= word == 0u || (words_of(length) <= WORDS - word && records->sector < SW_RECORD_SECTORS);
    }
    return sound;
}

static void start(sw_records *records)
{
    records->flash = &flash;
    ASSUME(is_sound(records));
}

void power_on(void)
{
    sw_records records;
    sw_records_open(&records, &flash);
    PROVE(is_sound(&records));
}

void any_read(void)
{
    sw_records records;
    uint8_t data[SW_FLASH_SECTOR];
    const uint32_t kind = nondet_uint(), offset = nondet_uint(), length = nondet_uint();
    start(&records);
    ASSUME(kind >= 1u && kind <= SW_RECORD_KINDS && length <= SW_FLASH_SECTOR);
    (void)sw_records_read(&records, (sw_record_kind)kind, offset, &data[SW_FLASH_SECTOR - length], length);
}

void any_keep(void)
{
    sw_records records;
    uint8_t data[SW_FLASH_SECTOR];
    const uint32_t kind = nondet_uint(), length = nondet_uint();
    start(&records);
    ASSUME(kind >= 1u && kind <= SW_RECORD_KINDS && length <= SW_FLASH_SECTOR && !records.is_erasing);
    (void)sw_records_keep(&records, (sw_record_kind)kind, data, length);
    PROVE(is_sound(&records));
}

void any_care(void)
{
    sw_records records;
    start(&records);
    sw_records_care(&records);
    PROVE(is_sound(&records));
}
