/* The flash memory that the store stands in, as the loader needs it: erased by sector, written once by word.
 *
 * Addresses are bytes from the start of the store's part of the flash, which the driver maps. Its sectors are, in order:
 * two for records, SW_SLOT_SECTORS for slot A, as many for slot B.
 */
#ifndef SW_FLASH_H
#define SW_FLASH_H

#include <stdint.h>

#define SW_FLASH_WORD 32u /* bytes that are programmed at once, and have one error-correcting code */
#ifndef SW_FLASH_SECTOR
#define SW_FLASH_SECTOR 131072u /* bytes that are erased at once */
#endif
#ifndef SW_SLOT_SECTORS
#define SW_SLOT_SECTORS 3u
#endif

#define SW_RECORD_SECTORS 2u
#define SW_SLOT_BYTES (SW_SLOT_SECTORS * SW_FLASH_SECTOR)
#define SW_FLASH_BYTES (SW_RECORD_SECTORS * SW_FLASH_SECTOR + 2u * SW_SLOT_BYTES)

/* How an erasure that was begun stands. */
typedef enum { SW_FLASH_DONE = 0, SW_FLASH_FAILED = 1, SW_FLASH_AT_WORK = 2 } sw_flash_state;

/* Each call but `erased` returns 0, or 1 if the memory failed. After a call in which the supply goes, the words that it
 * touched have any value, or none: reading them fails.
 *
 * Erasing takes a second on some chips, so `erase` only begins it: all bytes are 0xFF once `erased` is no longer AT_WORK,
 * and until then nothing but that is called. A driver gives an erasure up that takes longer than the chip's longest.
 */
typedef struct {
    void *context;
    const uint8_t *memory;                          /* where it is mapped */
    int (*erase)(void *context, uint32_t sector);   /* begins */
    sw_flash_state (*erased)(void *context);        /* how that stands */
    int (*program)(void *context, uint32_t address, const uint8_t *word); /* a word that was erased, to its end */
    int (*read)(void *context, uint32_t address, uint8_t *data, uint32_t length); /* 1: a word cannot be corrected */
} sw_flash;

#endif
