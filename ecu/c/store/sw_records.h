/* Records that outlive a loss of power, in two sectors of which one is written on until it is full.
 *
 * A record is a run of words: the first has its kind, its length and a CRC-32, and each word says in its first byte that
 * it is the first or a further one, so that nothing within a record is taken for another. The newest whole record of a
 * kind counts. A full sector is left by copying the newest records into the other one, whose first word, which makes it
 * the valid one, is written last.
 *
 * An erasure takes longer than a control period. Before the control begins it is waited for; later it is begun and looked
 * after by sw_records_care, while the jets are shut, so that the other sector is blank when it is needed.
 */
#ifndef SW_RECORDS_H
#define SW_RECORDS_H

#include <stdint.h>

#include "sw_flash.h"

#define SW_MAX_RECORD 8192u

/* The numbers are those of can_bridge/flashing/backing.py. */
typedef enum {
    SW_RECORD_STATE = 1,
    SW_RECORD_KEYS = 2,
    SW_RECORD_CALIBRATION = 3,
    SW_RECORD_FAULTS = 4
} sw_record_kind;
#define SW_RECORD_KINDS 4u

/* What may be done to keep a record. */
typedef enum {
    SW_RECORDS_WAIT = 0,   /* before the control begins: also erase the other sector, and wait */
    SW_RECORDS_MOVE = 1,   /* leave a full sector for the other one if that is blank */
    SW_RECORDS_APPEND = 2  /* while the jets run: nothing but write behind the last record */
} sw_records_limit;

/* What is known of the sector that is not in use. */
typedef enum { SW_OTHER_UNKNOWN = 0, SW_OTHER_BLANK = 1, SW_OTHER_BAD = 2 } sw_records_other;

typedef struct {
    const sw_flash *flash;
    uint8_t limit;                     /* sw_records_limit */
    uint8_t is_erasing;                /* an erasure, of whatever sector, is at work: nothing else may be done */
    uint8_t other;                     /* sw_records_other */
    uint32_t sector;                   /* that is valid; SW_RECORD_SECTORS: none is */
    uint32_t sequence;                 /* of that sector: the greater one is the newer */
    uint32_t end;                      /* word behind the last that was written */
    uint32_t words[SW_RECORD_KINDS];   /* first word of the newest record of each kind; 0: there is none */
    uint32_t lengths[SW_RECORD_KINDS]; /* its bytes */
} sw_records;

/* Find the records, after power-on; writes nothing. */
void sw_records_open(sw_records *records, const sw_flash *flash);

/* Blanks the sector next to one that is filling up, before the control begins. A failure shows when it is needed. */
void sw_records_tidy(sw_records *records);

/* A piece of work for later records: blanks the other sector, or leaves one that has been filling up. */
void sw_records_care(sw_records *records);

/* Begins to erase any sector of the memory, and looks how that stands; all erasures pass here. */
int sw_records_begin_erasing(sw_records *records, uint32_t sector);
sw_flash_state sw_records_erased(sw_records *records);

/* Whether a record of so many bytes has its place behind the last one. */
int sw_records_have_room(const sw_records *records, uint32_t length);

/* Bytes of a record from `offset` on, as many as are asked for; 1: it is not there, is shorter, or cannot be read. */
int sw_records_read(const sw_records *records, sw_record_kind kind, uint32_t offset, uint8_t *data, uint32_t length);

/* Bytes of the newest record of a kind; 0 where there is none. */
uint32_t sw_records_length(const sw_records *records, sw_record_kind kind);

/* Replace a record: afterwards, or after a loss of power, there is the old one or the new one. 1: no place is left that
 * works, or none that the limit allows, and the old one counts.
 */
int sw_records_keep(sw_records *records, sw_record_kind kind, const uint8_t *data, uint32_t length);

/* Bytes of a record: given ones, or, where `data` is NULL, those from `place` on of the record of its kind as it is kept. */
typedef struct {
    const uint8_t *data;
    uint32_t place, length;
} sw_part;

/* The same, of a record of several parts. */
int sw_records_keep_parts(sw_records *records, sw_record_kind kind, const sw_part *parts, uint32_t count);

/* CRC-32 as zlib has it, of what came before and this; 0 before the first. */
uint32_t sw_crc32(uint32_t before, const uint8_t *data, uint32_t length);

#endif
