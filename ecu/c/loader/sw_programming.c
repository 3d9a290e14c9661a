/* Programming by diagnosis: identifiers, routines and downloads over the store. */
#include "sw_programming.h"

#include "sw_node.h"

uint8_t sw_programming_refusal(sw_store_result result)
{
    uint8_t code = SW_NRC_OUT_OF_RANGE;
    switch (result) {
    case SW_STORE_DONE:
        code = SW_UDS_DONE;
        break;
    case SW_STORE_MORE:
        code = SW_UDS_MORE;
        break;
    case SW_STORE_OUT_OF_ORDER:
        code = SW_NRC_SEQUENCE_ERROR;
        break;
    case SW_STORE_BAD_MEMORY:
        code = SW_NRC_PROGRAMMING_FAILURE;
        break;
    default:
        break; /* a value that is not allowed */
    }
    return code;
}

void sw_programming_leave(sw_node *node)
{
    sw_store_drop(&node->store);
    /* A tester that goes away amid a transfer would leave the jets shut until the next power-on; the release that ran
     * before is in order, and a transfer that was interrupted goes on after a reset.
     */
    if (node->programming.is_updating) node->wants_reset = 1;
}

uint8_t sw_programming_before_reset(const sw_node *node)
{
    return node->programming.is_updating ? 0u : sw_node_refusal(node);
}

void sw_programming_digest(const uint8_t *data, uint32_t length, uint8_t digest[SW_BLOCK_DIGEST_BYTES])
{
    sw_sha256 hash;
    sw_sha256_begin(&hash);
    sw_sha256_add(&hash, data, length);
    sw_sha256_end(&hash, digest);
}

/* --- Identifiers --- */

static void put_report(const sw_store *store, sw_answer *answer)
{
    uint8_t report[SW_MAX_REPORT];
    sw_answer_bytes(answer, report, sw_store_report(store, report));
}

uint8_t sw_programming_read(sw_node *node, uint32_t number, sw_answer *answer)
{
    static const uint8_t dbc[] = SW_DBC_SHA256_BYTES;
    uint8_t code = 0;
    switch (number) {
    case SW_DID_ACTIVE_SESSION:
        sw_answer_byte(answer, node->uds.session);
        break;
    case SW_DID_SERIAL_NUMBER:
        sw_answer_text(answer, node->equipment->serial);
        break;
    case SW_DID_HARDWARE:
        sw_answer_text(answer, node->equipment->hardware);
        break;
    case SW_DID_SOFTWARE_VERSION:
        sw_answer_text(answer, node->equipment->software);
        break;
    case SW_DID_DBC_SHA256:
        sw_answer_bytes(answer, dbc, sizeof dbc);
        break;
    case SW_DID_PERIOD_NS:
        sw_answer_number(answer, (uint64_t)SW_PERIOD_NS, 8);
        break;
    case SW_DID_CAPACITY:
        sw_answer_number(answer, SW_SLOT_BYTES, 4);
        break;
    case SW_DID_KEY_LIST:
        sw_answer_number(answer, sw_key_list_version(node->store.keys), 4);
        break;
    case SW_DID_STORE:
        put_report(&node->store, answer);
        break;
    case SW_DID_CALIBRATION:
    case SW_DID_CALIBRATION_LIMITS:
    case SW_DID_CALIBRATION_STORED:
        code = sw_calibrating_read(node, number, answer);
        break;
    default:
        code = SW_NRC_OUT_OF_RANGE;
        break;
    }
    return code;
}

static uint8_t take_keys(sw_node *node, const uint8_t *value, uint32_t length)
{
    sw_programming *programming = &node->programming;
    uint8_t digest[SW_BLOCK_DIGEST_BYTES];
    int is_again = programming->has_keys;
    sw_programming_digest(value, length, digest);
    for (uint32_t i = 0; i < sizeof digest; i++) is_again &= digest[i] == programming->keys_digest[i];
    if (is_again) return SW_UDS_DONE;
    /* To verify a signature, here and before a way back, takes a good part of a control period. */
    uint8_t code = sw_node_refusal(node);
    if (code == 0u) code = sw_programming_refusal(sw_store_take_keys(&node->store, value, length));
    if (code == SW_UDS_DONE) {
        programming->has_keys = 1;
        for (uint32_t i = 0; i < sizeof digest; i++) programming->keys_digest[i] = digest[i];
    }
    return code;
}

uint8_t sw_programming_write(sw_node *node, uint32_t number, const uint8_t *value, uint32_t length)
{
    return number == SW_DID_KEY_LIST ? take_keys(node, value, length) : sw_calibrating_write(node, number, value);
}

/* --- Routines. What the store does in pieces is begun here, and `went_on` goes on with it. --- */

/* Their answers: what an announcement wants, what a check found. */
static uint8_t ended(sw_node *node, uint8_t code, sw_answer *answer)
{
    const sw_store *store = &node->store;
    const uint32_t number = sw_number(&node->uds.head[1], 2);
    if (code != SW_UDS_DONE) return code;
    if (number == SW_ROUTINE_ERASE) {
        sw_answer_number(answer, store->wanted, 4);
    } else if (number == SW_ROUTINE_CHECK) {
        sw_answer_byte(answer, store->verdict);
    } else if (store->verdict != SW_VERDICT_GOOD) {
        return SW_NRC_CONDITIONS_NOT_CORRECT; /* the release before may not run any more */
    } else {
        /* Going back has nothing to state. */
    }
    return SW_UDS_DONE;
}

static uint8_t went_on(sw_node *node, sw_answer *answer)
{
    sw_answer_bytes(answer, node->uds.head, sizeof node->uds.head);
    return ended(node, sw_programming_refusal(sw_store_go_on(&node->store)), answer);
}

static uint8_t begun(sw_node *node, sw_store_result result, sw_answer *answer)
{
    node->uds.work = went_on;
    return ended(node, sw_programming_refusal(result), answer);
}

static uint8_t announce(sw_node *node, const uint8_t *option, sw_answer *answer)
{
    const uint8_t code = sw_node_refusal(node);
    if (code != 0u) return code;
    node->programming.is_updating = 1;
    node->programming.has_passed = 0;
    node->programming.has_confirmed = 0;
    return begun(node, sw_store_announce(&node->store, sw_number(option, 4), &option[4]), answer);
}

/* A tester that confirms what does not run on trial takes another release for its own; and none stays that did not pass
 * its self-test since this boot.
 */
static uint8_t confirm(sw_node *node)
{
    const sw_store *store = &node->store;
    uint8_t code = SW_UDS_DONE;
    if (store->running != SW_NO_SLOT && store->state.slots[store->running].phase == SW_PHASE_TRIAL) {
        code = SW_NRC_SEQUENCE_ERROR;
        if (node->programming.has_passed) code = sw_programming_refusal(sw_store_confirm(&node->store));
        if (code == SW_UDS_DONE) node->programming.has_confirmed = 1;
    } else if (!node->programming.has_confirmed) {
        code = SW_NRC_SEQUENCE_ERROR;
    } else {
        /* The same again. */
    }
    return code;
}

uint8_t sw_programming_routine(sw_node *node, uint32_t number, const uint8_t *option, sw_answer *answer)
{
    uint8_t code = SW_UDS_DONE;
    switch (number) {
    case SW_ROUTINE_PRECONDITIONS:
        code = sw_node_refusal(node);
        break;
    case SW_ROUTINE_ERASE:
        code = announce(node, option, answer);
        break;
    case SW_ROUTINE_CHECK:
        code = begun(node, sw_store_finish(&node->store), answer);
        break;
    case SW_ROUTINE_ACTIVATE:
        code = sw_programming_refusal(sw_store_activate(&node->store));
        break;
    case SW_ROUTINE_SELF_TEST:
        code = sw_self_test(node, answer);
        break;
    case SW_ROUTINE_CONFIRM:
        code = confirm(node);
        break;
    default: /* SW_ROUTINE_REVERT: the table of routines has no other */
        code = sw_node_refusal(node);
        if (code == 0u) code = begun(node, sw_store_revert(&node->store), answer);
        break;
    }
    return code;
}

/* --- Downloads --- */

uint8_t sw_programming_download(const sw_node *node, uint32_t offset, uint32_t length)
{
    const sw_store *store = &node->store;
    if (store->announced == SW_NO_SLOT) return SW_NRC_SEQUENCE_ERROR;
    const sw_slot_state *slot = &store->state.slots[store->announced];
    const int is_missing = offset == slot->received && length == slot->length - slot->received;
    return is_missing ? 0u : SW_NRC_OUT_OF_RANGE;
}

uint8_t sw_programming_append(sw_node *node, const uint8_t *data, uint32_t length)
{
    return sw_programming_refusal(sw_store_append(&node->store, data, length));
}
