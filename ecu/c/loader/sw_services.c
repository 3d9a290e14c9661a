/* The services of UDS, and their permissions. A new service needs an entry in `rows`, and a function. */
#include "sw_services.h"

#include <stddef.h>

#define HARD_RESET 1u
#define START 1u
#define PLAIN 0x00u         /* data format of a download: neither compressed nor encrypted */
#define FOUR_AND_FOUR 0x44u /* a download request has 4 bytes of length and 4 bytes of address */
#define TWO_BYTES 0x20u     /* format of the block length in the answer to a download request */
#define P2_UNIT_MS 10u
#define ENABLE 0u
#define DISABLE_SENDING 1u
#define NORMAL 0x01u /* communication type that includes only JetCommand and EcuStatus */
#define NORMAL_AND_NETWORK 0x03u /* communication type that includes JetCommand, EcuStatus and network management */
#define COUNT(table) (sizeof(table) / sizeof(table)[0])

/* The permission to write an identifier or start a routine, and the number of data bytes (0xffff: any number). */
typedef struct {
    uint16_t number;
    uint8_t sessions;
    uint8_t level;
    uint16_t length;
} permission;

#define ANY 0xffffu
static const permission writable[] = {
    {SW_DID_KEY_LIST, SW_IN_PROGRAMMING, SW_LEVEL_PROGRAMMING, ANY},
    {SW_DID_CALIBRATION, SW_IN_EXTENDED, SW_LEVEL_CALIBRATION, sizeof(sw_calibration)},
    {SW_DID_CALIBRATION_STORED, SW_IN_EXTENDED, SW_LEVEL_CALIBRATION, 1},
};
static const permission routines[] = {
    {SW_ROUTINE_PRECONDITIONS, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 0, 0},
    {SW_ROUTINE_SELF_TEST, SW_IN_PROGRAMMING, SW_LEVEL_PROGRAMMING, 0},
    {SW_ROUTINE_ACTIVATE, SW_IN_PROGRAMMING, SW_LEVEL_PROGRAMMING, 0},
    {SW_ROUTINE_CONFIRM, SW_IN_PROGRAMMING, SW_LEVEL_PROGRAMMING, 0},
    {SW_ROUTINE_REVERT, SW_IN_PROGRAMMING, SW_LEVEL_PROGRAMMING, 0},
    {SW_ROUTINE_ERASE, SW_IN_PROGRAMMING, SW_LEVEL_PROGRAMMING, 4 + 32},
    {SW_ROUTINE_CHECK, SW_IN_PROGRAMMING, SW_LEVEL_PROGRAMMING, 0},
};

/* Checks session, unlocked level and length for an identifier or a routine. Returns 0 or an SW_NRC_ code. */
static uint8_t refusal(const sw_services *services, const permission *table, uint32_t count, uint32_t number,
                       uint32_t length)
{
    for (uint32_t i = 0; i < count; i++) {
        if (table[i].number != number) continue;
        if ((table[i].sessions & 1u << services->uds.session) == 0u) return SW_NRC_OUT_OF_RANGE;
        if (sw_uds_is_locked(&services->uds, table[i].level)) return SW_NRC_SECURITY_ACCESS_DENIED;
        return table[i].length == ANY || table[i].length == length ? 0u : SW_NRC_INCORRECT_LENGTH;
    }
    return SW_NRC_OUT_OF_RANGE;
}

static uint8_t control_session(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    const uint8_t session = body[0];
    if (session < SW_SESSION_DEFAULT || session > SW_SESSION_EXTENDED) return SW_NRC_SUB_FUNCTION_NOT_SUPPORTED;
    if (length != 1u) return SW_NRC_INCORRECT_LENGTH;
    if (session == SW_SESSION_PROGRAMMING) {
        const uint8_t code = sw_request_refusal(&services->request);
        if (code != 0u) return code;
    }
    sw_uds_change_session(&services->uds, session);
    sw_answer_byte(answer, session);
    sw_answer_number(answer, SW_P2_MS, 2);
    sw_answer_number(answer, SW_P2_EXTENDED_MS / P2_UNIT_MS, 2);
    return SW_UDS_DONE;
}

static uint8_t reset(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    if (body[0] != HARD_RESET) return SW_NRC_SUB_FUNCTION_NOT_SUPPORTED;
    if (length != 1u) return SW_NRC_INCORRECT_LENGTH;
    const uint8_t code = sw_programming_before_reset(&services->programming);
    if (code != 0u) return code;
    services->uds.reset_is_due = 1;
    sw_answer_byte(answer, body[0]);
    return SW_UDS_DONE;
}

static uint8_t control_communication(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    if (body[0] != ENABLE && body[0] != DISABLE_SENDING) return SW_NRC_SUB_FUNCTION_NOT_SUPPORTED;
    if (length != 2u) return SW_NRC_INCORRECT_LENGTH;
    if (body[1] != NORMAL && body[1] != NORMAL_AND_NETWORK) return SW_NRC_OUT_OF_RANGE;
    /* Sending is disabled only when a reset would be allowed, so that control is not interrupted. */
    const uint8_t code = body[0] == DISABLE_SENDING ? sw_programming_before_reset(&services->programming) : 0u;
    if (code != 0u) return code;
    services->uds.is_silent = (uint8_t)(body[0] == DISABLE_SENDING);
    sw_answer_byte(answer, body[0]);
    return SW_UDS_DONE;
}

static uint8_t hear_tester(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    (void)services;
    if (body[0] != 0u) return SW_NRC_SUB_FUNCTION_NOT_SUPPORTED;
    if (length != 1u) return SW_NRC_INCORRECT_LENGTH;
    sw_answer_byte(answer, body[0]);
    return SW_UDS_DONE;
}

/* Appends the value of an identifier to the answer. Returns 0, or an SW_NRC_ code if the identifier is unknown. */
static uint8_t identifier(const sw_services *services, uint32_t number, sw_answer *answer)
{
    static const uint8_t dbc[] = SW_DBC_SHA256_BYTES;
    uint8_t report[SW_MAX_REPORT];
    uint8_t code = 0;
    switch (number) {
    case SW_DID_ACTIVE_SESSION:
        sw_answer_byte(answer, services->uds.session);
        break;
    case SW_DID_SERIAL_NUMBER:
        sw_answer_text(answer, services->equipment->serial);
        break;
    case SW_DID_HARDWARE:
        sw_answer_text(answer, services->equipment->hardware);
        break;
    case SW_DID_SOFTWARE_VERSION:
        sw_answer_text(answer, services->equipment->software);
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
        sw_answer_number(answer, sw_key_list_version(services->uds.store->keys), 4);
        break;
    case SW_DID_STORE:
        sw_answer_bytes(answer, report, sw_store_report(services->uds.store, report));
        break;
    case SW_DID_CALIBRATION:
    case SW_DID_CALIBRATION_LIMITS:
    case SW_DID_CALIBRATION_STORED:
        code = sw_calibrating_read(&services->calibrating, number, answer);
        break;
    default:
        code = SW_NRC_OUT_OF_RANGE;
        break;
    }
    return code;
}

/* Reads identifiers. As in the standard, the answer omits unknown identifiers; if all are unknown, it is negative. */
static uint8_t read(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    const uint32_t before = answer->length;
    if (length == 0u || length % 2u != 0u || length > 2u * SW_MAX_DIDS) return SW_NRC_INCORRECT_LENGTH;
    for (uint32_t at = 0; at < length; at += 2u) {
        const uint32_t start = answer->length;
        sw_answer_bytes(answer, &body[at], 2);
        if (identifier(services, sw_number(&body[at], 2), answer) != 0u) answer->length = start;
    }
    if (answer->length == before) return SW_NRC_OUT_OF_RANGE;
    return answer->length > SW_LONGEST_ANSWER ? SW_NRC_RESPONSE_TOO_LONG : SW_UDS_DONE;
}

/* Handles security access. An odd sub-function requests a level's seed; the next even number sends the answer. */
static uint8_t give_access(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    const int is_answer = body[0] % 2u == 0u;
    const uint8_t level = (uint8_t)(is_answer ? body[0] - 1u : body[0]);
    const uint8_t session = level == SW_LEVEL_PROGRAMMING ? SW_SESSION_PROGRAMMING : SW_SESSION_EXTENDED;
    if (level != SW_LEVEL_PROGRAMMING && level != SW_LEVEL_CALIBRATION) return SW_NRC_SUB_FUNCTION_NOT_SUPPORTED;
    if (services->uds.session != session) return SW_NRC_SUB_FUNCTION_NOT_IN_SESSION;
    if (length != (is_answer ? 1u + SW_ANSWER_BYTES : 1u)) return SW_NRC_INCORRECT_LENGTH;
    sw_answer_byte(answer, body[0]);
    if (is_answer) {
        return sw_access_unlock(&services->uds.access, services->uds.store, services->uds.now_ns, level,
                                services->equipment->access_key, &body[1]);
    }
    uint8_t seed[SW_SEED_BYTES];
    const uint8_t code = sw_access_seed(&services->uds.access, services->uds.now_ns, level, services->equipment->random,
                                        services->equipment->context, seed);
    sw_answer_bytes(answer, seed, SW_SEED_BYTES);
    return code;
}

static uint8_t write(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    if (length <= 2u) return SW_NRC_INCORRECT_LENGTH;
    const uint32_t number = sw_number(body, 2);
    const uint8_t code = refusal(services, writable, COUNT(writable), number, length - 2u);
    if (code != 0u) return code;
    sw_answer_bytes(answer, body, 2);
    if (number != SW_DID_KEY_LIST) return sw_calibrating_write(&services->calibrating, number, &body[2]);
    return sw_programming_take_keys(&services->programming, &body[2], length - 2u);
}

static uint8_t routine(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    if (body[0] != START) return SW_NRC_SUB_FUNCTION_NOT_SUPPORTED;
    if (length < 3u) return SW_NRC_INCORRECT_LENGTH;
    const uint32_t number = sw_number(&body[1], 2);
    const uint8_t code = refusal(services, routines, COUNT(routines), number, length - 3u);
    if (code != 0u) return code;
    if (number == SW_ROUTINE_ERASE) services->transfer.state = SW_NO_TRANSFER;
    sw_answer_bytes(answer, body, 3);
    return sw_programming_begin(&services->programming, number, &body[3], answer);
}

static uint8_t routine_on(sw_services *services, sw_answer *answer)
{
    sw_answer_byte(answer, START);
    sw_answer_number(answer, services->programming.routine, 2);
    return sw_programming_go_on(&services->programming, answer);
}

/* --- A download: its blocks come in order. A tester that missed an answer repeats its request. --- */

static uint8_t download(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    sw_transfer *transfer = &services->transfer;
    if (length < 2u) return SW_NRC_INCORRECT_LENGTH;
    if (body[0] != PLAIN || body[1] != FOUR_AND_FOUR) return SW_NRC_OUT_OF_RANGE;
    if (length != 2u + 4u + 4u) return SW_NRC_INCORRECT_LENGTH;
    if (sw_uds_is_locked(&services->uds, SW_LEVEL_PROGRAMMING)) return SW_NRC_SECURITY_ACCESS_DENIED;
    const uint32_t offset = sw_number(&body[2], 4);
    const uint32_t bytes = sw_number(&body[6], 4);
    if (transfer->state != SW_TRANSFER_OPEN) {
        const uint8_t code = sw_programming_download(&services->programming, offset, bytes);
        if (code != 0u) return code;
        transfer->state = SW_TRANSFER_OPEN;
        transfer->offset = offset;
        transfer->length = bytes;
        transfer->missing = bytes;
        transfer->expected = 1;
        transfer->has_last = 0;
    } else if (transfer->has_last || transfer->offset != offset || transfer->length != bytes) {
        return SW_NRC_CONDITIONS_NOT_CORRECT;
    } else {
        /* A request that is repeated before the first block has arrived is acknowledged. */
    }
    sw_answer_byte(answer, TWO_BYTES);
    sw_answer_number(answer, SW_MAX_BLOCK, 2);
    return SW_UDS_DONE;
}

/* Returns SW_UDS_MORE if a block must be written, SW_UDS_DONE for a repeated last block, or an SW_NRC_ code. */
static uint8_t judged(const sw_transfer *transfer, uint8_t counter, uint32_t bytes, const uint8_t *digest)
{
    const int is_last = transfer->has_last && transfer->last == counter
                        && sw_bytes_equal(transfer->last_digest, digest, SW_SHA256_BYTES);
    if (transfer->state != SW_TRANSFER_OPEN) return SW_NRC_SEQUENCE_ERROR;
    if (is_last) return SW_UDS_DONE;
    if (transfer->missing == 0u) return SW_NRC_SEQUENCE_ERROR;
    if (counter != transfer->expected) return SW_NRC_WRONG_BLOCK_COUNTER;
    return bytes > transfer->missing ? SW_NRC_TRANSFER_SUSPENDED : SW_UDS_MORE;
}

/* Reopens the transfer after a block was written. A failed write ends the transfer: the slot's content is unknown. */
static uint8_t block_written(sw_transfer *transfer, uint8_t code)
{
    if (code == SW_UDS_DONE) transfer->state = SW_TRANSFER_OPEN;
    return code;
}

static uint8_t write_on(sw_services *services, sw_answer *answer)
{
    sw_answer_byte(answer, services->transfer.last);
    return block_written(&services->transfer, sw_store_refusal(sw_store_go_on(services->uds.store)));
}

static uint8_t take_block(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    sw_transfer *transfer = &services->transfer;
    uint8_t digest[SW_SHA256_BYTES];
    if (length < 2u || length >= SW_MAX_BLOCK) return SW_NRC_INCORRECT_LENGTH;
    if (sw_uds_is_locked(&services->uds, SW_LEVEL_PROGRAMMING)) return SW_NRC_SECURITY_ACCESS_DENIED;
    const uint32_t bytes = length - 1u;
    sw_sha256_of(&body[1], bytes, digest);
    const uint8_t verdict = judged(transfer, body[0], bytes, digest);
    sw_answer_byte(answer, body[0]);
    if (verdict != SW_UDS_MORE) return verdict;
    transfer->state = SW_NO_TRANSFER;
    transfer->missing -= bytes;
    transfer->expected = (uint8_t)(body[0] + 1u);
    transfer->has_last = 1;
    transfer->last = body[0];
    sw_bytes_copy(transfer->last_digest, digest, SW_SHA256_BYTES);
    return block_written(transfer, sw_store_refusal(sw_store_append(services->uds.store, &body[1], bytes)));
}

/* Ends a transfer after all its bytes have arrived. The check routine compares their hash with the announced hash. */
static uint8_t end_transfer(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    sw_transfer *transfer = &services->transfer;
    (void)body;
    (void)answer;
    if (length != 0u) return SW_NRC_INCORRECT_LENGTH;
    if (sw_uds_is_locked(&services->uds, SW_LEVEL_PROGRAMMING)) return SW_NRC_SECURITY_ACCESS_DENIED;
    if (transfer->state == SW_NO_TRANSFER || transfer->missing > 0u) return SW_NRC_SEQUENCE_ERROR;
    transfer->state = SW_TRANSFER_CLOSED;
    return SW_UDS_DONE;
}

/* --- Faults: sw_faults.c implements these services --- */

static uint8_t clear_faults(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    (void)answer;
    return sw_faults_clear(&services->faults, body, length);
}

static uint8_t report_faults(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    return sw_faults_report(&services->faults, body, length, answer);
}

static uint8_t set_faults(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer)
{
    return sw_faults_set(&services->faults, body, length, answer);
}

static const sw_service rows[] = {
    {SW_SERVICE_SESSION, SW_IN_ALL, 1, 0, control_session, NULL},
    /* The programming session begins only while the jets are shut. `reset` checks again whether they are shut. */
    {SW_SERVICE_RESET, SW_IN_PROGRAMMING, 1, 0, reset, NULL},
    {SW_SERVICE_CLEAR_FAULTS, SW_IN_ALL, 0, 1, clear_faults, NULL},
    {SW_SERVICE_REPORT_FAULTS, SW_IN_ALL, 1, 0, report_faults, NULL},
    {SW_SERVICE_READ, SW_IN_ALL, 0, 0, read, NULL},
    {SW_SERVICE_SECURITY, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 1, 1, give_access, NULL},
    {SW_SERVICE_COMMUNICATION, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 1, 0, control_communication, NULL},
    {SW_SERVICE_WRITE, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 0, 1, write, NULL},
    {SW_SERVICE_ROUTINE, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 1, 1, routine, routine_on},
    {SW_SERVICE_DOWNLOAD, SW_IN_PROGRAMMING, 0, 0, download, NULL},
    {SW_SERVICE_TRANSFER, SW_IN_PROGRAMMING, 0, 1, take_block, write_on},
    {SW_SERVICE_EXIT, SW_IN_PROGRAMMING, 0, 0, end_transfer, NULL},
    {SW_SERVICE_TESTER_PRESENT, SW_IN_ALL, 1, 0, hear_tester, NULL},
    {SW_SERVICE_FAULT_SETTING, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 1, 0, set_faults, NULL},
};

/* Drops an open transfer, which can be resumed later. If an image was announced, requests a reset: the jets stay shut
 * until a reset, and the tester may have disappeared. The earlier release is intact.
 */
static void end_session(sw_services *services, uint8_t next)
{
    sw_uds *uds = &services->uds;
    if (uds->session != SW_SESSION_DEFAULT) {
        sw_store_drop(services->uds.store);
        if (services->programming.is_updating) uds->wants_reset = 1;
    }
    if (next == SW_SESSION_DEFAULT) services->faults.is_off = 0;
    services->transfer.state = SW_NO_TRANSFER;
}

void sw_services_init(sw_services *services, const sw_equipment *equipment, sw_store *store, sw_isotp *isotp,
                      sw_ecu *ecu)
{
    static const sw_service_table table = {rows, COUNT(rows), end_session};
    services->equipment = equipment;
    services->uds.table = &table;
    services->uds.services = services;
    services->uds.isotp = isotp;
    services->uds.store = store;
    services->uds.session = SW_SESSION_DEFAULT;
    services->programming.ecu = ecu;
    services->programming.store = store;
    services->programming.request = &services->request;
    services->calibrating.ecu = ecu;
    services->calibrating.store = store;
    services->calibrating.request = &services->request;
    services->faults.ecu = ecu;
    services->faults.store = store;
    services->faults.request = &services->request;
}
