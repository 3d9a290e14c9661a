/* The calibration of the ECU through UDS and XCP. This file puts values in force, stores them and restores them. */
#include "sw_calibrating.h"

#include <stddef.h>

#include "sw_ecu.h"
#include "sw_ecu_parts.h"

#define REVERT 0u
#define STORE 1u

static void put(sw_answer *answer, const sw_calibration *values)
{
    sw_answer_bytes(answer, (const uint8_t *)values, sizeof *values);
}

#if SW_XCP
#define VALUE_BYTES 4u

const sw_calibration *sw_calibrating_in_force(const sw_calibrating *calibrating)
{
    return calibrating->page == SW_PAGE_WORKING ? &calibrating->working : &calibrating->release;
}
#else
static const sw_calibration *sw_calibrating_in_force(const sw_calibrating *calibrating) { return &calibrating->working; }
#endif

/* Puts the working page in force, and discards an incomplete value. */
static void put_in_force(sw_calibrating *calibrating)
{
    calibrating->is_changed = 1;
#if SW_XCP
    calibrating->begun = 0;
    calibrating->page = SW_PAGE_WORKING;
#endif
}

/* Changes the working page if all values are within their limits. Returns whether the page was changed. */
static int change(sw_calibrating *calibrating, const uint8_t *value)
{
    sw_calibration values;
    sw_bytes_copy((uint8_t *)&values, value, sizeof values);
    const int allowed = sw_calibration_beyond(&values, calibrating->ecu->numbers.release) == 0;
    if (allowed) {
        calibrating->working = values;
        calibrating->is_changed = 1;
    }
    return allowed;
}

static int set(sw_calibrating *calibrating, const uint8_t *value)
{
    const int allowed = change(calibrating, value);
    if (allowed) put_in_force(calibrating);
    return allowed;
}

void sw_calibrating_restore(sw_calibrating *calibrating)
{
    uint8_t kept[sizeof(sw_calibration)];
    calibrating->release = calibrating->ecu->calibration;
    calibrating->working = calibrating->release;
    const uint32_t length = sw_store_calibration(calibrating->store, kept, sizeof kept);
    calibrating->is_kept = length > 0u;
    if (length == sizeof(sw_calibration)) (void)set(calibrating, kept);
}

void sw_calibrating_hand_over(sw_calibrating *calibrating)
{
    if (calibrating->is_changed) (void)sw_ecu_calibrate(calibrating->ecu, sw_calibrating_in_force(calibrating));
    calibrating->is_changed = 0;
}

uint8_t sw_calibrating_read(const sw_calibrating *calibrating, uint32_t number, sw_answer *answer)
{
    if (calibrating->ecu->numbers.release == NULL) return SW_NRC_OUT_OF_RANGE;
    if (number == SW_DID_CALIBRATION) {
        put(answer, sw_calibrating_in_force(calibrating));
    } else if (number == SW_DID_CALIBRATION_LIMITS) {
        sw_calibration least, greatest;
        sw_calibration_bounds(calibrating->release.weights, &least, &greatest);
        put(answer, &least);
        put(answer, &greatest);
        put(answer, &calibrating->release);
    } else {
        sw_answer_byte(answer, calibrating->is_kept ? STORE : REVERT);
    }
    return 0;
}

/* Stores `length` bytes of `values`; length 0 deletes the stored values. Refuses both while the jets are driven. */
static uint8_t keep(sw_calibrating *calibrating, const sw_calibration *values, uint32_t length)
{
    if (calibrating->request->drives_jets) return SW_NRC_CONDITIONS_NOT_CORRECT;
    const sw_store_result result = sw_store_keep_calibration(calibrating->store, (const uint8_t *)values, length);
    if (result == SW_STORE_DONE) calibrating->is_kept = length > 0u;
    return sw_store_refusal(result);
}

uint8_t sw_calibrating_write(sw_calibrating *calibrating, uint32_t number, const uint8_t *value)
{
    const sw_calibration *values = sw_calibrating_in_force(calibrating);
    uint8_t code = 0;
    if (calibrating->ecu->numbers.release == NULL) return SW_NRC_OUT_OF_RANGE;
    if (number == SW_DID_CALIBRATION) return set(calibrating, value) ? 0u : SW_NRC_OUT_OF_RANGE;
    if (value[0] == STORE) {
        code = keep(calibrating, values, sizeof *values);
    } else if (value[0] == REVERT) {
        if (calibrating->is_kept) code = keep(calibrating, values, 0);
        if (code == 0u) {
            calibrating->working = calibrating->release;
            put_in_force(calibrating);
        }
    } else {
        code = SW_NRC_OUT_OF_RANGE;
    }
    return code;
}

#if SW_XCP
void sw_calibrating_select(sw_calibrating *calibrating, uint8_t page)
{
    calibrating->page = page;
    calibrating->is_changed = 1;
}

void sw_calibrating_copy_release(sw_calibrating *calibrating)
{
    calibrating->working = calibrating->release;
    calibrating->begun = 0;
    calibrating->is_changed = 1;
}

void sw_calibrating_bytes(const sw_calibrating *calibrating, uint8_t page, uint32_t at, uint32_t length, uint8_t *bytes)
{
    const int is_working = page == SW_PAGE_WORKING;
    const uint8_t *values = (const uint8_t *)(is_working ? &calibrating->working : &calibrating->release);
    for (uint32_t i = 0; i < length; i++) {
        const uint32_t begun = at + i - calibrating->begun_at;
        const int has_begun = is_working && at + i >= calibrating->begun_at && begun < calibrating->begun;
        bytes[i] = has_begun ? calibrating->begun_bytes[begun] : values[at + i];
    }
}

int sw_calibrating_write_bytes(sw_calibrating *calibrating, uint32_t at, const uint8_t *data, uint32_t length)
{
    uint8_t bytes[VALUE_BYTES + SW_XCP_MAX_CTO];
    uint8_t values[sizeof(sw_calibration)];
    const int goes_on = calibrating->begun > 0u && at == (uint32_t)calibrating->begun_at + calibrating->begun;
    const uint32_t before = goes_on ? calibrating->begun : 0u;
    const uint32_t start = at - before;
    if (start % VALUE_BYTES != 0u) return 0;
    sw_bytes_copy(bytes, calibrating->begun_bytes, before);
    sw_bytes_copy(&bytes[before], data, length);
    const uint32_t rest = (before + length) % VALUE_BYTES;
    const uint32_t whole = before + length - rest;
    calibrating->begun = 0;
    if (whole > 0u) {
        sw_bytes_copy(values, (const uint8_t *)&calibrating->working, sizeof values);
        sw_bytes_copy(&values[start], bytes, whole);
        if (!change(calibrating, values)) return 0;
    }
    calibrating->begun_at = (uint8_t)(start + whole);
    calibrating->begun = (uint8_t)rest;
    sw_bytes_copy(calibrating->begun_bytes, &bytes[whole], rest);
    return 1;
}

uint8_t sw_calibrating_store(sw_calibrating *calibrating, const sw_calibration *values)
{
    return keep(calibrating, values, sizeof *values);
}
#endif
