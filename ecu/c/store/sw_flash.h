/* The flash memory of the store. The loader erases it sector by sector, and writes each erased word only once.
 *
 * An address is a byte offset in the store's part of the flash; the driver converts it to the chip's address. The
 * sectors are, in order: two for records, SW_SLOT_SECTORS for slot A, and SW_SLOT_SECTORS for slot B.
 */
#ifndef SW_FLASH_H
#define SW_FLASH_H

#include <stdint.h>

#define SW_FLASH_WORD 32u /* bytes that are programmed together and share an error-correcting code */
#ifndef SW_FLASH_SECTOR
#define SW_FLASH_SECTOR 131072u /* bytes that are erased together */
#endif
#ifndef SW_SLOT_SECTORS
#define SW_SLOT_SECTORS 3u
#endif

#define SW_RECORD_SECTORS 2u
#define SW_SLOT_BYTES (SW_SLOT_SECTORS * SW_FLASH_SECTOR)
#define SW_FLASH_BYTES (SW_RECORD_SECTORS * SW_FLASH_SECTOR + 2u * SW_SLOT_BYTES)

/* The state of an erasure. */
typedef enum { SW_FLASH_DONE = 0, SW_FLASH_FAILED = 1, SW_FLASH_AT_WORK = 2 } sw_flash_state;

/* A driver. Each function except `erased` returns 0, or 1 if the memory failed. If the supply fails during a call, the
 * words that the call erases or programs may have any value or be unreadable.
 *
 * An erasure takes a second on some chips, so `erase` only begins it. While `erased` returns AT_WORK, no other function
 * is called. Once `erased` returns DONE, all bytes are 0xFF. If an erasure takes too long, `erased` returns FAILED.
 */
typedef struct {
    void *context;
    const uint8_t *memory;                                                /* pointer to the byte at address 0 */
    int (*erase)(void *context, uint32_t sector);                         /* begins an erasure */
    sw_flash_state (*erased)(void *context);                              /* state of the erasure */
    int (*program)(void *context, uint32_t address, const uint8_t *word); /* programs an erased word completely */
    int (*read)(void *context, uint32_t address, uint8_t *data, uint32_t length); /* 1 also if a word is unreadable */
} sw_flash;

#endif
