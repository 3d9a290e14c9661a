/* Records that outlive a loss of power, in two sectors of which one is written on until it is full.
 *
 * A record is a run of words: the first has its kind, its length and a CRC-32, and each word says in its first byte that
 * it is the first or a further one, so that nothing within a record is taken for another. The newest whole record of a
 * kind counts. A full sector is left by copying the newest records into the other one, whose first word, which makes it
 * the valid one, is written last.
 */
#ifndef SW_RECORDS_H
#define SW_RECORDS_H

#include <stdint.h>

#include "sw_flash.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SW_MAX_RECORD 8192u

/* As can_bridge/flashing/backing.py numbers them. */
typedef enum {
    SW_RECORD_STATE = 1,
    SW_RECORD_KEYS = 2,
    SW_RECORD_CALIBRATION = 3,
    SW_RECORD_FAULTS = 4
} sw_record_kind;
#define SW_RECORD_KINDS 4u

typedef struct {
    const sw_flash *flash;
    uint32_t sector;                   /* that is valid; SW_RECORD_SECTORS: none is */
    uint32_t sequence;                 /* of that sector: the greater one is the newer */
    uint32_t end;                      /* word behind the last that was written */
    uint32_t words[SW_RECORD_KINDS];   /* first word of the newest record of each kind; 0: there is none */
    uint32_t lengths[SW_RECORD_KINDS]; /* its bytes */
} sw_records;

/* Find the records, after power-on; writes nothing. */
void sw_records_open(sw_records *records, const sw_flash *flash);

/* Erase the sector that is not valid, unless it is blank, so that `keep` need not; a failure shows when it is needed. */
void sw_records_tidy(sw_records *records);

/* Bytes of a record from `offset` on, as many as are asked for; 1: it is not there, is shorter, or cannot be read. */
int sw_records_read(const sw_records *records, sw_record_kind kind, uint32_t offset, uint8_t *data, uint32_t length);

/* Bytes of the newest record of a kind; 0 where there is none. */
uint32_t sw_records_length(const sw_records *records, sw_record_kind kind);

/* Replace a record: afterwards, or after a loss of power, there is the old one or the new one. 1: no place is left that
 * works, and the old one counts.
 */
int sw_records_keep(sw_records *records, sw_record_kind kind, const uint8_t *data, uint32_t length);

/* Bytes of a record: given ones, or, where `data` is NULL, those from `place` on of the record of its kind as it is kept. */
typedef struct {
    const uint8_t *data;
    uint32_t place, length;
} sw_part;

/* The same, of a record of several parts. */
int sw_records_keep_parts(sw_records *records, sw_record_kind kind, const sw_part *parts, uint32_t count);

#ifdef __cplusplus
}
#endif

#endif
