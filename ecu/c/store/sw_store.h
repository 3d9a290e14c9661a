/* Two slots for releases, of which one runs and the other can be written: the twin of can_bridge/flashing/store.py.
 *
 *     announce, append .., finish     an image into the slot that is not protected; checked as it lies in the flash
 *     activate                        booted from the next reset on, SW_TRIAL_BOOTS times at most
 *     confirm                         it stays, and the least security version rises to its own
 *     revert                          back to the release before
 *
 * A loss of power may end any call: what it had kept until then is a state from which the next boot finds a valid image,
 * if there was one. Freestanding, no allocation, no static state. Long work is done in pieces: where a call answers
 * SW_STORE_MORE, call sw_store_go_on until it answers otherwise; the calls above, boot and drop throw that work away first,
 * and wait for an erasure that is at work. While sw_store_is_erasing, make no call but sw_store_go_on and those that read
 * state, facts and report.
 */
#ifndef SW_STORE_H
#define SW_STORE_H

#include <stdint.h>

#include "sw_crypto.h"
#include "sw_flash.h"
#include "sw_records.h"
#include "sw_release.h"

#define SW_TRIAL_BOOTS 3u
#define SW_PIECE 4096u /* bytes of an image that are read in one piece of work, */
#define SW_WRITTEN 512u /* and that are written in one */
#define SW_NO_SLOT 0xffu
#define SW_MAX_CALIBRATION 1024u
#define SW_MAX_REPORT 512u
#define SW_MOST_ATTEMPTS 255u

typedef enum {
    SW_STORE_DONE = 0,
    SW_STORE_MORE,         /* call sw_store_go_on */
    SW_STORE_OUT_OF_RANGE, /* ConfigError: a length that is too great, or none */
    SW_STORE_OUT_OF_ORDER, /* OutOfOrderError: does not fit what stands in the store now */
    SW_STORE_BAD_KEYS,     /* KeyFileError: a key list that is not taken */
    SW_STORE_BAD_MEMORY    /* MediumError */
} sw_store_result;

typedef enum {
    SW_PHASE_EMPTY = 0,
    SW_PHASE_FILLING = 1,   /* announced; its first `received` bytes are there */
    SW_PHASE_CHECKED = 2,   /* whole and in order */
    SW_PHASE_TRIAL = 3,     /* booted from the next reset on, boots_left times */
    SW_PHASE_CONFIRMED = 4, /* it runs, or ran before the release that runs */
    SW_PHASE_BAD = 5        /* never booted */
} sw_phase;

typedef enum {
    SW_BOOT_NONE = 0, /* not booted yet */
    SW_BOOT_CONFIRMED = 1,
    SW_BOOT_TRIAL = 2,
    SW_BOOT_REVERTED = 3,
    SW_BOOT_FALLBACK = 4,
    SW_BOOT_NO_RELEASE = 5
} sw_boot_reason;

/* can_bridge/flashing/state.py: SlotState. */
typedef struct {
    uint8_t phase; /* sw_phase */
    uint8_t boots_left;
    uint32_t length, received;
    uint8_t sha256[32]; /* of the announced image */
    sw_release_facts facts; /* zeros until the image was checked */
} sw_slot_state;

/* can_bridge/flashing/state.py: StoreState. Slots are 0 (A) and 1 (B). */
typedef struct {
    sw_slot_state slots[2];
    uint8_t active; /* slot of the confirmed image; SW_NO_SLOT: none was confirmed yet */
    uint8_t attempts[2];
    uint32_t least_security_version;
    uint8_t tail[2][SW_FLASH_WORD]; /* of each slot: bytes behind its last whole word */
} sw_store_state;

typedef enum { SW_WORK_NONE = 0, SW_WORK_CLEAR, SW_WORK_APPEND, SW_WORK_FINISH, SW_WORK_REVERT } sw_work;

/* What takes turns: reading an image, and changing the state, which is kept before it counts. */
typedef union {
    struct {
        sw_sha256 whole, payload;
        uint8_t header[SW_HEADER_BYTES];
    } image;
    struct {
        sw_store_state state;
        sw_slot_state slot; /* of the announced one, once it is erased */
    } next;
} sw_scratch;

/* Whether the build can run an image that stands in the flash, every other check of it passed. */
typedef int (*sw_store_opens)(const uint8_t *image);

typedef struct {
    const sw_flash *flash;
    const sw_rules *rules;
    sw_store_opens opens;
    sw_records records;
    sw_store_state state; /* as it is kept; read it, never write it */
    uint8_t keys[SW_KEY_LIST_BYTES]; /* the key list, as it was signed; zeros: this ECU has none, and takes nothing */
    uint8_t reason;      /* sw_boot_reason of the last boot */
    uint8_t verdicts[2]; /* sw_verdict of the last boot; SW_VERDICT_NONE: it did not look at this slot */
    uint8_t running;     /* the slot that was booted, as long as the image is still in it; or SW_NO_SLOT */
    uint8_t announced;   /* the slot of the transfer under way; or SW_NO_SLOT */
    uint8_t verdict;     /* result of `finish` and `revert` */
    uint32_t wanted;     /* result of `announce`: the offset from which bytes are wanted */
    /* Work in pieces. */
    uint8_t work, slot;  /* sw_work, and the slot that it is about */
    uint32_t at, until;  /* sectors to erase, bytes to read, or bytes that were appended of so many */
    const uint8_t *data; /* that are appended */
    sw_scratch scratch;
} sw_store;

/* Find what is kept, after power-on. All that is given stays in use. */
void sw_store_open(sw_store *store, const sw_flash *flash, const sw_rules *rules, sw_store_opens opens);

/* Choose an image and check all of it; a boot on trial is counted before it. Takes the time of one or two images. */
void sw_store_boot(sw_store *store);

/* The image that was booted, in place; NULL without one. It is void as soon as the slot is announced for another. */
const uint8_t *sw_store_image(const sw_store *store);

/* Its first bytes, copied; 1: they cannot be read. */
int sw_store_read_image(const sw_store *store, uint8_t *data, uint32_t length);

/* Make room for an image; then store->wanted is the offset of the bytes that are wanted: more than 0 where an interrupted
 * transfer of this very image can go on. OUT_OF_RANGE, OUT_OF_ORDER, BAD_MEMORY.
 */
sw_store_result sw_store_announce(sw_store *store, uint32_t length, const uint8_t sha256[32]);

/* The next bytes of the announced image, which stay where they are until this is done; they outlive a loss of power then.
 * OUT_OF_ORDER, BAD_MEMORY.
 */
sw_store_result sw_store_append(sw_store *store, const uint8_t *data, uint32_t length);

/* Check the announced image; then store->verdict says what was found. OUT_OF_ORDER, BAD_MEMORY. */
sw_store_result sw_store_finish(sw_store *store);

/* One more piece of announce, append, finish or revert; DONE without any. */
sw_store_result sw_store_go_on(sw_store *store);

/* Whether an erasure is at work. */
int sw_store_is_erasing(const sw_store *store);

/* The session ended: work and transfer are dropped; the next announcement of the same image goes on with it. */
void sw_store_drop(sw_store *store);

sw_store_result sw_store_activate(sw_store *store); /* OUT_OF_ORDER, BAD_MEMORY */
sw_store_result sw_store_confirm(sw_store *store);  /* OUT_OF_ORDER, BAD_MEMORY */

/* Go back from the next reset on; then store->verdict is GOOD, or why the release before may not run any more. */
sw_store_result sw_store_revert(sw_store *store); /* OUT_OF_ORDER, BAD_MEMORY */

/* Replace the key list by one that the root key signed. BAD_KEYS, BAD_MEMORY. */
sw_store_result sw_store_take_keys(sw_store *store, const uint8_t *data, uint32_t length);

/* Keep a calibration for the release that runs; length 0: none. OUT_OF_ORDER, OUT_OF_RANGE, BAD_MEMORY. */
sw_store_result sw_store_keep_calibration(sw_store *store, const uint8_t *data, uint32_t length);

/* The calibration that was kept for the release that runs: its length, 0: none; copied if it has at most `room` bytes. */
uint32_t sw_store_calibration(const sw_store *store, uint8_t *data, uint32_t room);

/* Whether the state can be kept now: not where the jets run and a sector is full. */
int sw_store_has_room(const sw_store *store);

/* Wrong keys in a row at a security level (0x01 programming, 0x03 calibration). OUT_OF_RANGE, BAD_MEMORY. */
uint8_t sw_store_failed_attempts(const sw_store *store, uint8_t level);
sw_store_result sw_store_keep_failed_attempts(sw_store *store, uint8_t level, uint32_t count);

/* The fault memory's record, of at most SW_MAX_RECORD bytes: into `room` bytes; its length, 0 where none is kept or it
 * does not fit. OUT_OF_RANGE, BAD_MEMORY.
 */
uint32_t sw_store_faults(const sw_store *store, uint8_t *data, uint32_t room);
sw_store_result sw_store_keep_faults(sw_store *store, const uint8_t *data, uint32_t length);

/* What a tester reads (can_bridge/flashing/report.py), into SW_MAX_REPORT bytes; its length. */
uint32_t sw_store_report(const sw_store *store, uint8_t *data);

/* Bytes there are of the announced image, the offset of the next ones; 0xffffffff: none is announced. */
uint32_t sw_store_received(const sw_store *store);

/* --- What the store's sources share; not for callers --- */

#define SW_NO_OFFSET 0xffffffffu

/* sw_store_kept.c: the state, and a copy of it in the scratch memory, to be changed and kept. */
void sw_state_open(sw_store *store);
void sw_state_empty_slot(sw_slot_state *slot);
sw_store_state *sw_state_draft(sw_store *store);
/* Returns 1 if it cannot be kept; the one before counts then. */
int sw_state_keep(sw_store *store, const sw_store_state *next);
int sw_state_slots_equal(const sw_slot_state *one, const sw_slot_state *other);
uint32_t sw_state_in_phase(const sw_store_state *state, sw_phase phase); /* SW_NO_SLOT: none is */
void sw_state_give_up(sw_slot_state *slot);

/* sw_store.c */
uint32_t sw_slots_address(uint32_t slot);

/* sw_store_judge.c: one piece of it returns 1 if there is more to do; the header of a good one stands in the scratch memory
 * at the end.
 */
void sw_judge_begin(sw_store *store, uint32_t slot);
int sw_judge_go_on(sw_store *store);
sw_verdict sw_judge_end(sw_store *store);

#endif
