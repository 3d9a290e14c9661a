/* The two slots for releases. The release in one slot runs, and the other slot can be written. This file corresponds to
 * can_bridge/flashing/store.py.
 *
 *     announce, append .., finish     write an image into the slot that is not protected, and check it in flash
 *     activate                        lets the image boot from the next reset on, at most SW_TRIAL_BOOTS times
 *     confirm                         ends the trial; raises the minimum security version to the image's version
 *     revert                          lets the previous release boot at the next reset
 *
 * A power loss may interrupt any call. The next boot uses the stored state, and finds a valid image if there was one
 * before. The code is freestanding, without allocation or static state. Long work is done in parts: after
 * SW_STORE_MORE, call sw_store_go_on until it returns another result. The calls above, sw_store_boot and sw_store_drop
 * first discard unfinished work; if this work is an erasure, they wait until it has ended. While sw_store_is_erasing,
 * call only sw_store_go_on, sw_store_drop and functions that do not access the flash, such as sw_store_report.
 */
#ifndef SW_STORE_H
#define SW_STORE_H

#include <stdint.h>

#include "sw_crypto.h"
#include "sw_flash.h"
#include "sw_records.h"
#include "sw_release.h"

#define SW_TRIAL_BOOTS 3u
#define SW_PIECE 4096u  /* number of bytes of an image that one part of the work reads */
#define SW_WRITTEN 512u /* number of bytes of an image that one part of the work writes */
#define SW_NO_SLOT 0xffu
#define SW_MAX_CALIBRATION 1024u
#define SW_MAX_REPORT 512u
#define SW_MOST_ATTEMPTS 255u

typedef enum {
    SW_STORE_DONE = 0,
    SW_STORE_MORE,         /* the work is not finished: call sw_store_go_on */
    SW_STORE_OUT_OF_RANGE, /* a length is 0 or too great, or a security level is unknown (ConfigError in Python) */
    SW_STORE_OUT_OF_ORDER, /* the call is not allowed in the present state (OutOfOrderError) */
    SW_STORE_BAD_KEYS,     /* the key list is refused (KeyFileError) */
    SW_STORE_BAD_MEMORY    /* the flash memory failed (MediumError) */
} sw_store_result;

typedef enum {
    SW_PHASE_EMPTY = 0,
    SW_PHASE_FILLING = 1,   /* the image is announced; its first `received` bytes are stored */
    SW_PHASE_CHECKED = 2,   /* the image is complete and valid */
    SW_PHASE_TRIAL = 3,     /* the image boots from the next reset on, at most boots_left times */
    SW_PHASE_CONFIRMED = 4, /* the image was confirmed; its release runs now, or ran before the running release */
    SW_PHASE_BAD = 5        /* the image is never booted */
} sw_phase;

typedef enum {
    SW_BOOT_NONE = 0, /* not booted yet */
    SW_BOOT_CONFIRMED = 1,
    SW_BOOT_TRIAL = 2,
    SW_BOOT_REVERTED = 3,
    SW_BOOT_FALLBACK = 4,
    SW_BOOT_NO_RELEASE = 5
} sw_boot_reason;

/* The state of a slot, as SlotState in can_bridge/flashing/state.py. */
typedef struct {
    uint8_t phase; /* sw_phase */
    uint8_t boots_left;
    uint32_t length, received;
    uint8_t sha256[32];     /* SHA-256 of the announced image */
    sw_release_facts facts; /* zeros until the image is checked */
} sw_slot_state;

/* The state of the store, as StoreState in can_bridge/flashing/state.py. Slots are 0 (A) and 1 (B). */
typedef struct {
    sw_slot_state slots[2];
    uint8_t active; /* slot of the image that boots if no image is on trial; SW_NO_SLOT: none */
    uint8_t attempts[2];
    uint32_t least_security_version;
    uint8_t tail[2][SW_FLASH_WORD]; /* bytes of each slot after its last complete word */
} sw_store_state;

typedef enum { SW_WORK_NONE = 0, SW_WORK_CLEAR, SW_WORK_APPEND, SW_WORK_FINISH, SW_WORK_REVERT } sw_work;

/* The scratch memory for reading an image or changing the state. A changed state takes effect when it is stored. */
typedef union {
    struct {
        sw_sha256 whole, payload;
        uint8_t header[SW_HEADER_BYTES];
    } image;
    struct {
        sw_store_state state;
        sw_slot_state slot; /* state of the announced image's slot after the slot's erasure */
    } next;
} sw_scratch;

/* Returns whether the build can run an image in the flash. The image has passed all other checks. */
typedef int (*sw_store_opens)(const uint8_t *image);

typedef struct {
    const sw_flash *flash;
    const sw_rules *rules;
    sw_store_opens opens;
    sw_records records;
    sw_store_state state;            /* the stored state; callers may only read it */
    uint8_t keys[SW_KEY_LIST_BYTES]; /* the signed key list; zeros: there is no list, and the ECU accepts no release */
    uint8_t reason;      /* sw_boot_reason of the last boot */
    uint8_t verdicts[2]; /* sw_verdict of the last boot; SW_VERDICT_NONE: slot not checked */
    uint8_t running;     /* the booted slot, until its image is overwritten; or SW_NO_SLOT */
    uint8_t announced;   /* the slot of the present transfer; or SW_NO_SLOT */
    uint8_t verdict;     /* verdict of the latest `finish` or `revert` */
    uint32_t wanted;     /* result of `announce`: offset of the next bytes to send */
    /* Long work; it is done in parts. */
    uint8_t work, slot;  /* sw_work, and the slot that it changes or checks */
    uint32_t at, until;  /* at: number of sectors erased, or bytes read or appended; until: number of bytes to append */
    const uint8_t *data; /* bytes to append */
    sw_scratch scratch;
} sw_store;

/* Finds the stored records after power-on. The arguments must stay valid while the store is used. */
void sw_store_open(sw_store *store, const sw_flash *flash, const sw_rules *rules, sw_store_opens opens);

/* Chooses and checks an image; if it fails, checks the other image. A boot on trial is counted before the check. */
void sw_store_boot(sw_store *store);

/* Returns the booted image's address in the flash, or NULL; valid until an image is announced for the same slot. */
const uint8_t *sw_store_image(const sw_store *store);

/* Copies the first `length` bytes of the booted image. Returns 1 if the bytes cannot be read. */
int sw_store_read_image(const sw_store *store, uint8_t *data, uint32_t length);

/* Prepares a slot for an image. Afterwards store->wanted is the offset of the next bytes to send: more than 0 if an
 * interrupted transfer of this image can continue. Errors: OUT_OF_RANGE, OUT_OF_ORDER, BAD_MEMORY.
 */
sw_store_result sw_store_announce(sw_store *store, uint32_t length, const uint8_t sha256[32]);

/* Appends bytes to the announced image. `data` must stay unchanged until the work is done. Afterwards the bytes survive
 * a power loss. Errors: OUT_OF_ORDER, BAD_MEMORY.
 */
sw_store_result sw_store_append(sw_store *store, const uint8_t *data, uint32_t length);

/* Checks the announced image; afterwards store->verdict has the result. Errors: OUT_OF_ORDER, BAD_MEMORY. */
sw_store_result sw_store_finish(sw_store *store);

/* Executes the next part of announce, append, finish or revert; returns DONE if there is no work. */
sw_store_result sw_store_go_on(sw_store *store);

/* Returns whether an erasure is running. */
int sw_store_is_erasing(const sw_store *store);

/* Ends a session: drops the work and the transfer in progress. Announcing the image again continues the transfer. */
void sw_store_drop(sw_store *store);

sw_store_result sw_store_activate(sw_store *store); /* errors: OUT_OF_ORDER, BAD_MEMORY */
sw_store_result sw_store_confirm(sw_store *store);  /* errors: OUT_OF_ORDER, BAD_MEMORY */

/* Lets the earlier release boot at the next reset. store->verdict is then GOOD, or names the check that failed. */
sw_store_result sw_store_revert(sw_store *store); /* errors: OUT_OF_ORDER, BAD_MEMORY */

/* Replaces the key list by a list that the root key signed. Errors: BAD_KEYS, BAD_MEMORY. */
sw_store_result sw_store_take_keys(sw_store *store, const uint8_t *data, uint32_t length);

/* Stores a calibration for the running release; length 0 deletes it. Errors: OUT_OF_ORDER, OUT_OF_RANGE, BAD_MEMORY. */
sw_store_result sw_store_keep_calibration(sw_store *store, const uint8_t *data, uint32_t length);

/* Copies the running release's stored calibration if it has at most `room` bytes. Returns its length, or 0. */
uint32_t sw_store_calibration(const sw_store *store, uint8_t *data, uint32_t room);

/* Returns whether the state can be stored now. While the jets run, this requires room in the sector in use. */
int sw_store_has_room(const sw_store *store);

/* Read and store the number of consecutive wrong keys at a security level (0x01 programming, 0x03 calibration). Errors:
 * OUT_OF_RANGE, BAD_MEMORY.
 */
uint8_t sw_store_failed_attempts(const sw_store *store, uint8_t level);
sw_store_result sw_store_keep_failed_attempts(sw_store *store, uint8_t level, uint32_t count);

/* Read and store the record of the fault memory, of at most SW_MAX_RECORD bytes. sw_store_faults copies a record of at
 * most `room` bytes and returns its length, or 0 if there is no such record. Errors: OUT_OF_RANGE, BAD_MEMORY.
 */
uint32_t sw_store_faults(const sw_store *store, uint8_t *data, uint32_t room);
sw_store_result sw_store_keep_faults(sw_store *store, const uint8_t *data, uint32_t length);

/* Writes the report for testers (can_bridge/flashing/report.py), up to SW_MAX_REPORT bytes; returns its length. */
uint32_t sw_store_report(const sw_store *store, uint8_t *data);

/* Returns the number of received bytes of the announced image; 0xffffffff if no image is announced. */
uint32_t sw_store_received(const sw_store *store);

/* --- Functions that the store's sources share; not for callers --- */

#define SW_NO_OFFSET 0xffffffffu

/* sw_store_kept.c: the state, and its draft: a copy in the scratch memory that can be changed and then stored. */
void sw_state_open(sw_store *store);
void sw_state_empty_slot(sw_slot_state *slot);
sw_store_state *sw_state_draft(sw_store *store);
/* Stores the next state. Returns 1 if it cannot be stored; the previous state then stays valid. */
int sw_state_keep(sw_store *store, const sw_store_state *next);
int sw_state_slots_equal(const sw_slot_state *one, const sw_slot_state *other);
uint32_t sw_state_in_phase(const sw_store_state *state, sw_phase phase); /* a slot in this phase, or SW_NO_SLOT */
void sw_state_give_up(sw_slot_state *slot);

/* sw_store.c */
uint32_t sw_slots_address(uint32_t slot);

/* sw_store_judge.c: the judgement of a slot. sw_judge_go_on executes one part and returns 1 if more parts follow. If
 * sw_judge_end returns GOOD, the scratch memory has the image's header.
 */
void sw_judge_begin(sw_store *store, uint32_t slot);
int sw_judge_go_on(sw_store *store);
sw_verdict sw_judge_end(sw_store *store);

#endif
