/* Calibration by diagnosis: in force, stored, restored. */
#include "sw_calibrating.h"

#include "sw_ecu_parts.h"
#include "sw_node.h"

#define REVERT 0u
#define STORE 1u

static const sw_calibration least = SW_LEAST_CALIBRATION;

static const sw_calibration greatest = SW_GREATEST_CALIBRATION;

/* A release may have a greater weight than others can be given. */
static sw_calibration greatest_of(const sw_calibration *release)
{
    sw_calibration most = greatest;
    for (int i = 0; i < SW_TERMS; i++) {
        if (release->weights[i] > most.weights[i]) most.weights[i] = release->weights[i];
    }
    return most;
}

static int are_equal(const sw_calibration *one, const sw_calibration *other)
{
    int equal = one->delay_steps == other->delay_steps;
    for (int i = 0; i < SW_TERMS; i++) equal &= one->weights[i] <= other->weights[i] && one->weights[i] >= other->weights[i];
    equal &= one->action_limit <= other->action_limit && one->action_limit >= other->action_limit;
    return equal & (one->command_step <= other->command_step && one->command_step >= other->command_step);
}

static sw_calibration unpacked(const uint8_t *value)
{
    sw_calibration values;
    uint8_t *bytes = (uint8_t *)&values;
    for (size_t i = 0; i < sizeof values; i++) bytes[i] = value[i];
    return values;
}

static void put(sw_answer *answer, const sw_calibration *values)
{
    sw_answer_bytes(answer, (const uint8_t *)values, sizeof *values);
}

/* Puts values in force, if all of them are in the limits. Returns whether they are. */
static int set(sw_node *node, const uint8_t *value)
{
    const sw_calibration values = unpacked(value);
    const int allowed = sw_calibration_beyond(&values, node->ecu.numbers.release) == 0;
    if (allowed) node->calibrating.working = values;
    return allowed;
}

void sw_calibrating_restore(sw_node *node)
{
    uint8_t kept[sizeof(sw_calibration)];
    node->calibrating.release = node->ecu.calibration;
    node->calibrating.working = node->ecu.calibration;
    const uint32_t length = sw_store_calibration(&node->store, kept, sizeof kept);
    node->calibrating.is_kept = length > 0u;
    if (length == sizeof(sw_calibration)) (void)set(node, kept);
}

void sw_calibrating_hand_over(sw_node *node)
{
    if (!are_equal(&node->calibrating.working, &node->ecu.calibration)) {
        (void)sw_ecu_calibrate(&node->ecu, &node->calibrating.working);
    }
}

uint8_t sw_calibrating_read(const sw_node *node, uint32_t number, sw_answer *answer)
{
    const sw_calibration *release = &node->calibrating.release;
    if (node->is_shut) return SW_NRC_OUT_OF_RANGE;
    if (number == SW_DID_CALIBRATION) {
        put(answer, &node->calibrating.working);
    } else if (number == SW_DID_CALIBRATION_LIMITS) {
        const sw_calibration most = greatest_of(release);
        put(answer, &least);
        put(answer, &most);
        put(answer, release);
    } else {
        sw_answer_byte(answer, node->calibrating.is_kept ? STORE : REVERT);
    }
    return 0;
}

/* Writing a flash memory can take longer than a control period. */
static uint8_t keep(sw_node *node, const sw_calibration *values)
{
    if (node->drives_jets) return SW_NRC_CONDITIONS_NOT_CORRECT;
    const uint32_t length = values == NULL ? 0u : (uint32_t)sizeof *values;
    const sw_store_result result = sw_store_keep_calibration(&node->store, (const uint8_t *)values, length);
    if (result == SW_STORE_DONE) node->calibrating.is_kept = length > 0u;
    return sw_programming_refusal(result);
}

uint8_t sw_calibrating_write(sw_node *node, uint32_t number, const uint8_t *value)
{
    uint8_t code = 0;
    if (node->is_shut) return SW_NRC_OUT_OF_RANGE;
    if (number == SW_DID_CALIBRATION) return set(node, value) ? 0u : SW_NRC_OUT_OF_RANGE;
    if (value[0] == STORE) {
        code = keep(node, &node->calibrating.working);
    } else if (value[0] == REVERT) {
        if (node->calibrating.is_kept) code = keep(node, NULL);
        if (code == 0u) node->calibrating.working = node->calibrating.release;
    } else {
        code = SW_NRC_OUT_OF_RANGE;
    }
    return code;
}
