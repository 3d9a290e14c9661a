/* The fault memory, and the services with which testers read and clear it. */
#include "sw_faults.h"

#include <stddef.h>

#include "sw_ecu_parts.h"

/* The bits of a status (ISO 14229-1, table D.1). */
#define TEST_FAILED 0x01u
#define FAILED_THIS_CYCLE 0x02u
#define PENDING 0x04u
#define CONFIRMED 0x08u
#define NOT_COMPLETED_SINCE_CLEAR 0x10u
#define FAILED_SINCE_CLEAR 0x20u
#define NOT_COMPLETED_THIS_CYCLE 0x40u
#define AT_FAILURE (TEST_FAILED | FAILED_THIS_CYCLE | PENDING | CONFIRMED | FAILED_SINCE_CLEAR)
#define UNTESTED (NOT_COMPLETED_SINCE_CLEAR | NOT_COMPLETED_THIS_CYCLE)

/* The stored record has a magic number, then status, age, has_snapshot and snapshot of each fault, then a CRC-32. */
#define MAGIC 4u
#define FAULT_BYTES (3u + SW_SNAPSHOT_BYTES)
#define BODY_END (MAGIC + SW_FAULT_COUNT * FAULT_BYTES)
#define RECORD_BYTES (BODY_END + 4u)

#define CODE_BYTES 3u
#define ALL_GROUPS 0xffffffu
#define RECORD 0x01u /* number of a code's only snapshot, and of the code's only extended record */
#define ALL_RECORDS 0xffu
#define ON 1u
#define OFF 2u
#define MOST_16 0xffffu
#define NS_PER_MS 1000000

static const uint8_t magic[MAGIC] = {'S', 'W', 'F', '1'};

static const struct {
    uint8_t reason;
    uint32_t code;
} codes[SW_FAULT_COUNT] = SW_FAULT_CODES;

/* --- One fault --- */

static void untested(sw_fault *fault)
{
    fault->status = UNTESTED;
    fault->age = 0;
    fault->has_snapshot = 0;
    sw_bytes_fill(fault->snapshot, 0, SW_SNAPSHOT_BYTES);
}

static void failed(sw_fault *fault, const uint8_t snapshot[SW_SNAPSHOT_BYTES])
{
    if ((fault->status & FAILED_THIS_CYCLE) == 0u) {
        fault->has_snapshot = 1;
        sw_bytes_copy(fault->snapshot, snapshot, SW_SNAPSHOT_BYTES);
    }
    fault->status = (uint8_t)((fault->status | AT_FAILURE) & ~UNTESTED);
    fault->age = 0;
}

static void begin_cycle(sw_fault *fault)
{
    uint32_t status = fault->status;
    if ((status & (FAILED_THIS_CYCLE | NOT_COMPLETED_THIS_CYCLE)) == 0u) {
        status &= ~PENDING;
        const uint32_t age = (status & CONFIRMED) != 0u ? fault->age + 1u : 0u;
        if (age >= SW_AGED_CYCLES) {
            status &= ~CONFIRMED;
            untested(fault);
        } else {
            fault->age = (uint8_t)age;
        }
    }
    fault->status = (uint8_t)((status & ~(TEST_FAILED | FAILED_THIS_CYCLE)) | NOT_COMPLETED_THIS_CYCLE);
}

/* --- The record --- */

static void packed(const sw_faults *faults, uint8_t record[RECORD_BYTES])
{
    sw_bytes_copy(record, magic, MAGIC);
    for (uint32_t i = 0; i < SW_FAULT_COUNT; i++) {
        const sw_fault *fault = &faults->faults[i];
        uint8_t *at = &record[MAGIC + i * FAULT_BYTES];
        /* Bits that the next power-on overwrites get a fixed value, so that their changes alone cause no write. */
        uint32_t status = fault->status & ~TEST_FAILED;
        if ((status & (PENDING | CONFIRMED)) == 0u) status |= NOT_COMPLETED_THIS_CYCLE;
        at[0] = (uint8_t)status;
        at[1] = fault->age;
        at[2] = fault->has_snapshot;
        sw_bytes_copy(&at[3], fault->snapshot, SW_SNAPSHOT_BYTES);
    }
    sw_put_big_u32(&record[BODY_END], sw_crc32(0, record, BODY_END));
}

static int is_sound(const uint8_t *record, uint32_t length)
{
    return length == RECORD_BYTES && sw_bytes_equal(record, magic, MAGIC)
           && sw_big_u32(&record[BODY_END]) == sw_crc32(0, record, BODY_END);
}

void sw_faults_open(sw_faults *faults)
{
    uint8_t record[RECORD_BYTES];
    const uint32_t length = sw_store_faults(faults->store, record, RECORD_BYTES);
    const int sound = is_sound(record, length);
    for (uint32_t i = 0; i < SW_FAULT_COUNT; i++) {
        sw_fault *fault = &faults->faults[i];
        const uint8_t *at = &record[MAGIC + i * FAULT_BYTES];
        untested(fault);
        if (sound) {
            fault->status = (uint8_t)(at[0] & SW_FAULTS_AVAILABLE);
            fault->age = at[1];
            fault->has_snapshot = (uint8_t)(at[2] != 0u);
            if (fault->has_snapshot) sw_bytes_copy(fault->snapshot, &at[3], SW_SNAPSHOT_BYTES);
        }
        begin_cycle(fault);
    }
}

/* Stores the record if it differs from the stored record. Returns an sw_store_result. */
static sw_store_result keep_if_different(sw_faults *faults)
{
    uint8_t record[RECORD_BYTES];
    uint8_t kept[RECORD_BYTES];
    packed(faults, record);
    const uint32_t length = sw_store_faults(faults->store, kept, RECORD_BYTES);
    if (length == RECORD_BYTES && sw_bytes_equal(record, kept, RECORD_BYTES)) return SW_STORE_DONE;
    return sw_store_keep_faults(faults->store, record, RECORD_BYTES);
}

/* --- From control periods --- */

static int place_of_reason(uint8_t reason)
{
    int place = -1;
    for (int i = 0; i < (int)SW_FAULT_COUNT; i++) {
        if (codes[i].reason == reason) place = i;
    }
    return place;
}

static void take(sw_faults *faults, uint8_t reason, const uint8_t snapshot[SW_SNAPSHOT_BYTES])
{
    const int place = place_of_reason(reason);
    if (place >= 0) {
        failed(&faults->faults[place], snapshot);
    } else {
        for (uint32_t i = 0; i < SW_FAULT_COUNT; i++) {
            faults->faults[i].status = (uint8_t)(faults->faults[i].status & ~(TEST_FAILED | UNTESTED));
        }
    }
    faults->is_changed = 1;
}

/* Records a test result. While `is_off` is set, the result waits instead, and replaces an earlier waiting result. */
static void note(sw_faults *faults, uint8_t reason)
{
    if (faults->is_off) {
        faults->has_latest = 1;
        faults->latest = reason;
    } else {
        take(faults, reason, faults->latest_snapshot);
    }
}

/* Records the result that waited while `is_off` was set. */
static void take_waiting(sw_faults *faults)
{
    if (!faults->has_latest || faults->is_off) return;
    faults->has_latest = 0;
    take(faults, faults->latest, faults->latest_snapshot);
}

static uint32_t least(uint64_t one, uint32_t other) { return one < other ? (uint32_t)one : other; }

static uint32_t bits_of(float value)
{
    uint32_t bits;
    sw_bytes_copy((uint8_t *)&bits, (const uint8_t *)&value, sizeof bits);
    return bits;
}

static void take_snapshot(sw_faults *faults, int64_t since_power_on_ns)
{
    const sw_ecu_state *state = &faults->ecu->state;
    sw_answer kept = {faults->latest_snapshot, SW_SNAPSHOT_BYTES, 0};
    const int64_t past_ns = since_power_on_ns < 0 ? 0 : since_power_on_ns;
    sw_answer_number(&kept, least((uint64_t)(past_ns / NS_PER_MS), UINT32_MAX), 4);
    sw_answer_byte(&kept, sw_mode_on_wire(faults->was));
    sw_answer_number(&kept, least(state->missed, MOST_16), 2);
    sw_answer_number(&kept, least(state->overruns, MOST_16), 2);
    for (int i = 0; i < SW_SENSORS; i++) sw_answer_number(&kept, bits_of(faults->pressures_cp[i]), 4);
}

void sw_faults_before(sw_faults *faults)
{
    const sw_ecu_state *state = &faults->ecu->state;
    take_waiting(faults);
    faults->was = state->fail_safe.mode;
    for (int i = 0; i < SW_SENSORS; i++) {
        faults->pressures_cp[i] = (float)state->memory.window[SW_WINDOW - 1][i];
    }
}

void sw_faults_after(sw_faults *faults, int64_t now_ns)
{
    const sw_fail_safe *fail_safe = &faults->ecu->state.fail_safe;
    const int is_first = !faults->has_power_on;
    if (is_first) faults->power_on_ns = now_ns;
    faults->has_power_on = 1;
    /* If control begins again and its first step fails, a fault ends and another begins in one period. */
    const int fails_again = fail_safe->reason == SW_REASON_INTERNAL && fail_safe->misses + fail_safe->good == 0u;
    if (fail_safe->mode == faults->was && !is_first && !fails_again) return;
    if (fail_safe->mode == SW_CONTROL) {
        note(faults, SW_REASON_NONE);
    } else if (fail_safe->mode == SW_FAULT && place_of_reason(fail_safe->reason) >= 0) {
        take_snapshot(faults, now_ns - faults->power_on_ns);
        note(faults, fail_safe->reason);
    } else {
        /* This mode gives no test result. */
    }
}

void sw_faults_settle(sw_faults *faults)
{
    take_waiting(faults);
    if (faults->is_changed && !faults->request->drives_jets && !sw_store_is_erasing(faults->store)) {
        faults->is_changed = 0;
        (void)keep_if_different(faults);
    }
}

/* --- Services --- */

static int place_of_code(uint32_t code)
{
    int place = -1;
    for (int i = 0; i < (int)SW_FAULT_COUNT; i++) {
        if (codes[i].code == code) place = i;
    }
    return place;
}

uint8_t sw_faults_clear(sw_faults *faults, const uint8_t *body, uint32_t length)
{
    if (length != CODE_BYTES) return SW_NRC_INCORRECT_LENGTH;
    const uint32_t group = sw_number(body, CODE_BYTES);
    const int place = place_of_code(group);
    if (group != ALL_GROUPS && place < 0) return SW_NRC_OUT_OF_RANGE;
    if (faults->request->drives_jets) return SW_NRC_CONDITIONS_NOT_CORRECT;
    for (int i = 0; i < (int)SW_FAULT_COUNT; i++) {
        if (group == ALL_GROUPS || i == place) untested(&faults->faults[i]);
    }
    return sw_store_refusal(keep_if_different(faults));
}

static void put_fault(const sw_faults *faults, uint32_t place, sw_answer *answer)
{
    sw_answer_number(answer, codes[place].code, CODE_BYTES);
    sw_answer_byte(answer, faults->faults[place].status);
}

/* Counts the faults with a status bit of `mask`, or all faults if `mask` is 0; writes them unless `answer` is NULL. */
static uint32_t list(const sw_faults *faults, uint32_t mask, sw_answer *answer)
{
    uint32_t found = 0;
    for (uint32_t i = 0; i < SW_FAULT_COUNT; i++) {
        if (mask != 0u && (faults->faults[i].status & mask) == 0u) continue;
        found++;
        if (answer != NULL) put_fault(faults, i, answer);
    }
    return found;
}

static void put_snapshot(const sw_fault *fault, sw_answer *answer)
{
    static const struct {
        uint16_t identifier;
        uint8_t bytes;
    } parts[] = SW_SNAPSHOT_PARTS;
    uint32_t at = 0;
    sw_answer_byte(answer, sizeof parts / sizeof parts[0]);
    for (uint32_t i = 0; i < sizeof parts / sizeof parts[0]; i++) {
        sw_answer_number(answer, parts[i].identifier, 2);
        sw_answer_bytes(answer, &fault->snapshot[at], parts[i].bytes);
        at += parts[i].bytes;
    }
}

static uint8_t put_record(const sw_faults *faults, const uint8_t *body, sw_answer *answer)
{
    const int place = place_of_code(sw_number(&body[1], CODE_BYTES));
    const uint8_t number = body[1u + CODE_BYTES];
    if (place < 0 || (number != RECORD && number != ALL_RECORDS)) return SW_NRC_OUT_OF_RANGE;
    const sw_fault *fault = &faults->faults[place];
    put_fault(faults, (uint32_t)place, answer);
    if (!fault->has_snapshot) return SW_UDS_DONE;
    sw_answer_byte(answer, RECORD);
    if (body[0] == SW_REPORT_EXTENDED) {
        sw_answer_byte(answer, fault->age);
    } else {
        put_snapshot(fault, answer);
    }
    return SW_UDS_DONE;
}

uint8_t sw_faults_report(const sw_faults *faults, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    const int is_record = body[0] == SW_REPORT_SNAPSHOT || body[0] == SW_REPORT_EXTENDED;
    const int is_masked = body[0] == SW_REPORT_COUNT || body[0] == SW_REPORT_BY_STATUS;
    if (!is_record && !is_masked && body[0] != SW_REPORT_SUPPORTED) return SW_NRC_SUB_FUNCTION_NOT_SUPPORTED;
    if (length != (is_record ? 2u + CODE_BYTES : (is_masked ? 2u : 1u))) return SW_NRC_INCORRECT_LENGTH;
    sw_answer_byte(answer, body[0]);
    if (is_record) return put_record(faults, body, answer);
    const uint32_t mask = is_masked ? body[1] & SW_FAULTS_AVAILABLE : SW_FAULTS_AVAILABLE;
    sw_answer_byte(answer, SW_FAULTS_AVAILABLE);
    if (body[0] == SW_REPORT_COUNT) {
        sw_answer_byte(answer, SW_FAULTS_FORMAT);
        sw_answer_number(answer, mask == 0u ? 0u : list(faults, mask, NULL), 2);
    } else if (!is_masked) {
        (void)list(faults, 0, answer);
    } else if (mask != 0u) {
        (void)list(faults, mask, answer);
    } else {
        /* A mask without a bit selects no fault. */
    }
    return SW_UDS_DONE;
}

uint8_t sw_faults_set(sw_faults *faults, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    if (body[0] != ON && body[0] != OFF) return SW_NRC_SUB_FUNCTION_NOT_SUPPORTED;
    if (length != 1u) return SW_NRC_INCORRECT_LENGTH;
    faults->is_off = (uint8_t)(body[0] == OFF);
    sw_answer_byte(answer, body[0]);
    return SW_UDS_DONE;
}
