/* The protocol of flashing, on the code of the store: two slots, a record that is kept whole or not at all, and a supply
 * that may go at any operation of the flash, also while the ECU boots again. Every call is begun in every state that the
 * ones before can have left, so that the proofs hold for any order of any number of calls.
 *
 * Images are numbers below IMAGES; which of them are signed, and their security versions, is free. A slot that is being
 * written or erased may hold any of them: what an attacker sends, and what a cut leaves, among it an old release.
 */
#define DIGESTS
#include "bytes_model.h"

/* The scratch memory's two uses side by side, where solvers are quick; when one begins, the other has any value. */
#define union struct
#include "sw_store.c"
#undef union
#undef WORD
#define is_blank is_blank_word
#include "sw_store_judge.c"

#define IMAGES 4u
#define PIECES 2 /* of a sector's erasure, or of an image's check */

static sw_store store;
static sw_store_state kept; /* what the flash holds of the state */
static uint8_t content[2];  /* image of each slot */
static int runs[IMAGES];    /* signed by an allowed key, for this ECU, and of this build */
static uint32_t version[IMAGES];
static int powered;
static int has_header; /* in the scratch memory */

static uint8_t any_image(void)
{
    const uint8_t image = nondet_uchar();
    ASSUME(image < IMAGES);
    return image;
}

static int is_in_order(uint8_t image, uint32_t least) { return runs[image] && version[image] >= least; }

/* --- The flash memory, until the supply goes --- */

static void may_cut(void)
{
    if (nondet_int()) powered = 0;
}

static int change(uint32_t address)
{
    const uint32_t slot = address >= sw_slots_address(1) ? 1u : 0u;
    PROVE(address >= sw_slots_address(0) && address < SW_FLASH_BYTES); /* never a record */
    PROVE(slot == store.slot);                                         /* never the other slot */
    PROVE(slot != kept.active);                                        /* never what is booted next */
    if (!powered) return 1;
    content[slot] = any_image();
    may_cut();
    return nondet_int() != 0;
}

static int program(void *context, uint32_t address, const uint8_t *word)
{
    (void)context;
    (void)touch(word, SW_FLASH_WORD);
    PROVE(address % SW_FLASH_WORD == 0u);
    return change(address);
}

static int read_flash(void *context, uint32_t address, uint8_t *data, uint32_t length)
{
    (void)context;
    PROVE(length <= SW_FLASH_BYTES && address <= SW_FLASH_BYTES - length);
    if (length > 0u) data[0] = data[length - 1u] = nondet_uchar();
    return 0;
}

static const uint8_t memory[SW_FLASH_BYTES];
static const sw_flash flash = {NULL, memory, NULL, NULL, program, read_flash};

int sw_records_begin_erasing(sw_records *records, uint32_t sector)
{
    const int failed = change(sector * SW_FLASH_SECTOR);
    records->is_erasing = failed == 0;
    return failed;
}

sw_flash_state sw_records_erased(sw_records *records)
{
    const int state = nondet_int();
    ASSUME(state >= SW_FLASH_DONE && state <= SW_FLASH_AT_WORK);
    records->is_erasing = state == SW_FLASH_AT_WORK;
    return (sw_flash_state)state;
}

/* --- The record: kept whole, or as it was (records.c) --- */

int sw_state_keep(sw_store *of, const sw_store_state *next)
{
    if (!powered) return 1;
    may_cut();
    if (nondet_int()) return 1;
    kept = *next;
    if (!powered) return 1;
    of->state = *next;
    return 0;
}

sw_store_state *sw_state_draft(sw_store *of)
{
    has_header = 0;
    of->scratch.next.state = of->state;
    return &of->scratch.next.state;
}

void sw_state_empty_slot(sw_slot_state *slot)
{
    static const sw_slot_state none = {0};
    *slot = none;
}

int sw_state_slots_equal(const sw_slot_state *one, const sw_slot_state *other)
{
    return one->phase == other->phase && one->boots_left == other->boots_left && one->length == other->length &&
           one->received == other->received && one->sha256[0] == other->sha256[0] &&
           one->facts.security_version == other->facts.security_version;
}

uint32_t sw_state_in_phase(const sw_store_state *state, sw_phase phase)
{
    if (state->slots[0].phase == (uint8_t)phase) return 0;
    return state->slots[1].phase == (uint8_t)phase ? 1u : SW_NO_SLOT;
}

void sw_state_give_up(sw_slot_state *slot)
{
    slot->phase = SW_PHASE_BAD;
    slot->boots_left = 0;
}

/* --- Digests and signatures that nobody can forge (release.c) --- */

void sw_sha256_begin(sw_sha256 *hash)
{
    sw_store any;
    (void)hash;
    store.scratch.next = any.scratch.next;
    has_header = 1;
}

void sw_sha256_add(sw_sha256 *hash, const uint8_t *data, uint32_t length) { (void)hash, (void)data, (void)length; }
void sw_sha256_end(sw_sha256 *hash, uint8_t digest[32]) { (void)hash, digest[0] = content[store.slot]; }

sw_verdict sw_release_judge(const uint8_t *header, uint32_t length, const uint8_t *payload, const uint8_t *keys,
                            const sw_rules *rules, uint32_t least)
{
    (void)header, (void)length, (void)payload, (void)keys, (void)rules;
    return is_in_order(content[store.slot], least) ? SW_VERDICT_GOOD : SW_VERDICT_TOO_OLD;
}

void sw_release_read(const uint8_t *header, sw_release_facts *facts)
{
    (void)header;
    PROVE(has_header);
    facts->security_version = version[content[store.slot]];
}

int sw_key_is_allowed(const uint8_t *list, const uint8_t *key) { return (void)list, (void)key, nondet_int() != 0; }
static int opens(const uint8_t *image) { return (void)touch(image, SW_SLOT_BYTES), 1; }

/* --- What holds between two calls --- */

static int is_sound_slot(const sw_slot_state *slot)
{
    int sound = slot->phase <= SW_PHASE_BAD && slot->length <= SW_SLOT_BYTES && slot->received <= slot->length;
    sound &= slot->boots_left <= SW_TRIAL_BOOTS && slot->sha256[0] < IMAGES;
    const int checked = slot->phase >= SW_PHASE_CHECKED && slot->phase <= SW_PHASE_CONFIRMED;
    return sound && (!checked || slot->facts.security_version == version[slot->sha256[0]]);
}

/* In the flash: one slot is confirmed, holds the image it should, and that may run. */
static int is_bootable(const sw_store_state *state)
{
    const uint32_t active = state->active;
    return active < 2u && is_sound_slot(&state->slots[0]) && is_sound_slot(&state->slots[1]) &&
           state->slots[active].phase == SW_PHASE_CONFIRMED && state->slots[active].sha256[0] == content[active] &&
           is_in_order(content[active], state->least_security_version);
}

/* In memory, while the supply is there. */
static int is_sound_store(void)
{
    const sw_store_state *state = &store.state;
    const uint32_t running = store.running, announced_slot = store.announced;
    int sound = state->active == kept.active && state->least_security_version == kept.least_security_version &&
                sw_state_slots_equal(&state->slots[0], &kept.slots[0]) &&
                sw_state_slots_equal(&state->slots[1], &kept.slots[1]);
    sound &= running == SW_NO_SLOT || running < 2u;
    sound &= announced_slot == SW_NO_SLOT || announced_slot < 2u;
    if (!sound) return 0;
    const uint8_t of_active = store.verdicts[state->active];
    sound &= of_active == SW_VERDICT_NONE || of_active == SW_VERDICT_GOOD;
    if (running != SW_NO_SLOT) {
        const uint8_t phase = state->slots[running].phase;
        sound &= phase == SW_PHASE_TRIAL || phase == SW_PHASE_CONFIRMED || phase == SW_PHASE_BAD;
        sound &= is_in_order(content[running], state->least_security_version) && announced_slot != running;
        sound &= phase == SW_PHASE_BAD || state->slots[running].sha256[0] == content[running];
        sound &= store.verdicts[running] == SW_VERDICT_GOOD;
    }
    if (announced_slot != SW_NO_SLOT) {
        const uint8_t phase = state->slots[announced_slot].phase;
        sound &= phase == SW_PHASE_FILLING || phase == SW_PHASE_CHECKED || phase == SW_PHASE_BAD;
    }
    return sound;
}

static void any_flash(void)
{
    sw_store_state any;
    sw_store any_memory;
    store = any_memory;
    for (uint32_t i = 0; i < IMAGES; i++) {
        runs[i] = nondet_int();
        version[i] = nondet_uint();
    }
    content[0] = any_image();
    content[1] = any_image();
    kept = any;
    powered = 1;
    ASSUME(is_bootable(&kept));
    store.work = SW_WORK_NONE;
    store.records.is_erasing = 0;
    store.flash = &flash;
    store.opens = opens;
    store.state = kept;
}

static void any_store(void)
{
    any_flash();
    store.running = nondet_uchar();
    store.announced = nondet_uchar();
    store.verdicts[0] = nondet_uchar();
    store.verdicts[1] = nondet_uchar();
    store.slot = (uint8_t)(nondet_uchar() & 1u);
    ASSUME(is_sound_store());
}

static void holds_now(void)
{
    PROVE(is_bootable(&kept));
    if (powered) PROVE(is_sound_store());
}

/* Further pieces of the work that was begun, PIECES at most; or the session ends amid it. */
static void go_on(sw_store_result result, uint8_t work)
{
    for (int i = 0; i < PIECES && result == SW_STORE_MORE && powered; i++) {
        PROVE(store.work == work);
        store.work = work; /* the same, as a constant */
        result = sw_store_go_on(&store);
    }
    if (result == SW_STORE_MORE && powered) {
        store.records.is_erasing = 0;
        store.work = work;
        sw_store_drop(&store);
    }
    holds_now();
}

/* --- The calls --- */

void announce(void)
{
    any_store();
    uint8_t sha256[32];
    ASSUME(sha256[0] < IMAGES);
    go_on(sw_store_announce(&store, nondet_uint(), sha256), SW_WORK_CLEAR);
}

void append(void)
{
    any_store();
    uint8_t data[SW_SLOT_BYTES];
    const uint32_t length = nondet_uint();
    ASSUME(length <= SW_SLOT_BYTES);
    PROVE(sw_store_append(&store, data, length) != SW_STORE_MORE); /* a slot has less than a piece */
    holds_now();
}

void finish(void)
{
    any_store();
    go_on(sw_store_finish(&store), SW_WORK_FINISH);
}

void activate(void)
{
    any_store();
    (void)sw_store_activate(&store);
    holds_now();
}

void confirm(void)
{
    any_store();
    (void)sw_store_confirm(&store);
    holds_now();
}

void revert(void)
{
    any_store();
    go_on(sw_store_revert(&store), SW_WORK_REVERT);
}

/* Power-on, also one that is cut again; and a boot to its end, which runs a release that may run. */
static void boot_with(uint8_t active, uint8_t phase)
{
    const uint32_t other = 1u - active;
    any_flash();
    ASSUME(kept.active == active && kept.slots[other].phase == phase);
    kept.active = store.state.active = active;
    kept.slots[active].phase = store.state.slots[active].phase = SW_PHASE_CONFIRMED;
    kept.slots[other].phase = store.state.slots[other].phase = phase;
    const uint8_t boots = kept.slots[other].boots_left;
    sw_store_boot(&store);
    PROVE(is_bootable(&kept));
    if (!powered) return;
    const uint32_t running = store.running;
    PROVE(running < 2u);
    PROVE(is_in_order(content[running], kept.least_security_version));
    PROVE(kept.slots[running].sha256[0] == content[running]);
    PROVE(kept.slots[running].phase == SW_PHASE_CONFIRMED || kept.slots[running].phase == SW_PHASE_TRIAL);
    /* On trial it is counted before it runs, SW_TRIAL_BOOTS times at most. */
    if (running == other && phase == SW_PHASE_TRIAL) {
        PROVE(boots > 0u && boots <= SW_TRIAL_BOOTS && kept.slots[other].boots_left == boots - 1u);
    }
    PROVE(is_sound_store());
}

void boot(void)
{
    const int which = nondet_int();
    for (uint8_t phase = SW_PHASE_EMPTY; phase <= SW_PHASE_BAD; phase++) {
        if (which == phase) boot_with(0, phase);
        if (which == 6 + phase) boot_with(1, phase);
    }
}
