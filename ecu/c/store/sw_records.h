/* The records that survive a power loss, in two sectors. When the sector in use is full, the other sector is used.
 *
 * A record consists of consecutive words. The first word of a record has kind, length and a CRC-32. The first byte of
 * each word states whether the word is the first or a further word of a record. No part of a record can therefore look
 * like another record. The newest complete record of a kind is valid. When a sector is full, the newest records are
 * copied into the other sector. The first word of a sector makes the sector valid, and is written last.
 *
 * An erasure takes longer than a control period. Before the first control period, the functions wait until an erasure
 * has ended. Later they do not wait: sw_records_care erases the other sector in advance, while the jets are shut.
 */
#ifndef SW_RECORDS_H
#define SW_RECORDS_H

#include <stdint.h>

#include "sw_flash.h"

#define SW_MAX_RECORD 8192u

/* The kinds of records. The numbers are as in can_bridge/flashing/backing.py. */
typedef enum {
    SW_RECORD_STATE = 1,
    SW_RECORD_KEYS = 2,
    SW_RECORD_CALIBRATION = 3,
    SW_RECORD_FAULTS = 4
} sw_record_kind;
#define SW_RECORD_KINDS 4u

/* The permitted ways to store a record. */
typedef enum {
    SW_RECORDS_WAIT = 0,  /* before control begins: the code may erase the other sector and wait until it is blank */
    SW_RECORDS_MOVE = 1,  /* records are added, and may move from a full sector to a blank sector */
    SW_RECORDS_APPEND = 2 /* while the jets run: records are only added after the last record */
} sw_records_limit;

/* The known state of the sector that is not in use. */
typedef enum { SW_OTHER_UNKNOWN = 0, SW_OTHER_BLANK = 1, SW_OTHER_BAD = 2 } sw_records_other;

typedef struct {
    const sw_flash *flash;
    uint8_t limit;                     /* sw_records_limit */
    uint8_t is_erasing;                /* an erasure of any sector is running; until its end, do not use the flash */
    uint8_t other;                     /* sw_records_other */
    uint32_t sector;                   /* the sector in use; SW_RECORD_SECTORS if no sector is valid */
    uint32_t sequence;                 /* sequence number of the sector in use: the later of two valid sectors */
    uint32_t end;                      /* number of the first word after the written words */
    uint32_t words[SW_RECORD_KINDS];   /* number of the first word of each kind's newest record; 0: none */
    uint32_t lengths[SW_RECORD_KINDS]; /* lengths of the newest records of each kind, in bytes */
} sw_records;

/* Finds the records after power-on, without writing. */
void sw_records_open(sw_records *records, const sw_flash *flash);

/* Blanks the unused sector before control begins, if the sector in use is more than half full; ignores a failure. */
void sw_records_tidy(sw_records *records);

/* Executes one part of maintenance: blanks the unused sector, or moves the records there if many words are outdated. */
void sw_records_care(sw_records *records);

/* Begins to erase a sector; sw_records_erased checks the progress. All erasures use these two functions. */
int sw_records_begin_erasing(sw_records *records, uint32_t sector);
sw_flash_state sw_records_erased(sw_records *records);

/* Returns whether a record of `length` bytes fits after the last record. */
int sw_records_have_room(const sw_records *records, uint32_t length);

/* Copies bytes of a record from `offset` on. Returns 1 if the record is missing, too short or unreadable. */
int sw_records_read(const sw_records *records, sw_record_kind kind, uint32_t offset, uint8_t *data, uint32_t length);

/* Returns the length of the newest record of a kind; 0 if there is none. */
uint32_t sw_records_length(const sw_records *records, sw_record_kind kind);

/* Replaces a record. If the power fails meanwhile, either the old or the new record is valid. Returns 1, and the old
 * record stays valid, if the record is too long, an erasure runs, `limit` forbids a necessary move, or writing fails.
 */
int sw_records_keep(sw_records *records, sw_record_kind kind, const uint8_t *data, uint32_t length);

/* A part of a record: the bytes at `data`; if `data` is NULL, the bytes of the stored record from `place` on. */
typedef struct {
    const uint8_t *data;
    uint32_t place, length;
} sw_part;

/* Replaces a record, like sw_records_keep, with a record that consists of several parts. */
int sw_records_keep_parts(sw_records *records, sw_record_kind kind, const sw_part *parts, uint32_t count);

/* Continues zlib's CRC-32 with these data; `before` is the CRC of the earlier data, or 0 without earlier data. */
uint32_t sw_crc32(uint32_t before, const uint8_t *data, uint32_t length);

#endif
