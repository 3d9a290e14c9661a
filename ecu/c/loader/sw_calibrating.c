/* Calibration by diagnosis: in force, stored, restored. */
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

/* Puts values in force, if all of them are in the limits. Returns whether they are. */
static int set(sw_calibrating *calibrating, const uint8_t *value)
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
    if (calibrating->is_changed) (void)sw_ecu_calibrate(calibrating->ecu, &calibrating->working);
    calibrating->is_changed = 0;
}

uint8_t sw_calibrating_read(const sw_calibrating *calibrating, uint32_t number, sw_answer *answer)
{
    if (calibrating->ecu->numbers.release == NULL) return SW_NRC_OUT_OF_RANGE;
    if (number == SW_DID_CALIBRATION) {
        put(answer, &calibrating->working);
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

/* Keeps `length` bytes of the values in force, none for 0. Writing a flash memory can take longer than a control period. */
static uint8_t keep(sw_calibrating *calibrating, uint32_t length)
{
    if (calibrating->request->drives_jets) return SW_NRC_CONDITIONS_NOT_CORRECT;
    const uint8_t *values = (const uint8_t *)&calibrating->working;
    const sw_store_result result = sw_store_keep_calibration(calibrating->store, values, length);
    if (result == SW_STORE_DONE) calibrating->is_kept = length > 0u;
    return sw_store_refusal(result);
}

uint8_t sw_calibrating_write(sw_calibrating *calibrating, uint32_t number, const uint8_t *value)
{
    uint8_t code = 0;
    if (calibrating->ecu->numbers.release == NULL) return SW_NRC_OUT_OF_RANGE;
    if (number == SW_DID_CALIBRATION) return set(calibrating, value) ? 0u : SW_NRC_OUT_OF_RANGE;
    if (value[0] == STORE) {
        code = keep(calibrating, sizeof calibrating->working);
    } else if (value[0] == REVERT) {
        if (calibrating->is_kept) code = keep(calibrating, 0);
        if (code == 0u) {
            calibrating->working = calibrating->release;
            calibrating->is_changed = 1;
        }
    } else {
        code = SW_NRC_OUT_OF_RANGE;
    }
    return code;
}
