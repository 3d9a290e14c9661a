/* UDS: any request, in any state of the server, over a store that answers anything. */
#include "bytes_model.h"

#define set set_values
#define put put_values
#include "sw_access.c"
#include "sw_calibrating.c"
#undef set
#undef put
#include "sw_faults.c"
#define is_within is_within_most
#include "sw_programming.c"
#include "sw_services.c"
#include "sw_uds.c"

#define REQUEST 48u /* bytes: the longest of a routine, of a key and of a calibration, and one more */
#define ROOM 64u

static sw_services services;
static sw_isotp isotp;
static sw_store store;
static sw_ecu ecu;
static sw_release release;
static uint8_t message[SW_ISOTP_MOST];
static uint8_t answers[ROOM];

/* --- The store, which answers anything; and by whom it may be asked to write --- */

static sw_store_result any_result(void)
{
    const int result = nondet_int();
    ASSUME(result >= SW_STORE_DONE && result <= SW_STORE_BAD_MEMORY);
    return (sw_store_result)result;
}

static void by_a_programmer(void)
{
    PROVE(services.uds.session == SW_SESSION_PROGRAMMING && services.uds.access.unlocked == SW_LEVEL_PROGRAMMING);
}

static void while_shut(void) { PROVE(!services.request.drives_jets); }

sw_store_result sw_store_announce(sw_store *of, uint32_t length, const uint8_t sha256[32])
{
    (void)of, (void)length, (void)touch(sha256, 32);
    by_a_programmer();
    while_shut();
    return any_result();
}

sw_store_result sw_store_append(sw_store *of, const uint8_t *data, uint32_t length)
{
    (void)of, (void)touch(data, length);
    by_a_programmer();
    return any_result();
}

sw_store_result sw_store_finish(sw_store *of) { return (void)of, by_a_programmer(), any_result(); }
sw_store_result sw_store_activate(sw_store *of) { return (void)of, by_a_programmer(), any_result(); }
sw_store_result sw_store_revert(sw_store *of) { return (void)of, by_a_programmer(), while_shut(), any_result(); }
sw_store_result sw_store_go_on(sw_store *of) { return (void)of, any_result(); }

sw_store_result sw_store_confirm(sw_store *of)
{
    (void)of;
    by_a_programmer();
    PROVE(services.programming.has_passed); /* the self-test */
    return any_result();
}

sw_store_result sw_store_take_keys(sw_store *of, const uint8_t *data, uint32_t length)
{
    (void)of, (void)touch(data, length);
    by_a_programmer();
    while_shut();
    return any_result();
}

sw_store_result sw_store_keep_calibration(sw_store *of, const uint8_t *data, uint32_t length)
{
    (void)of, (void)touch(data, length);
    PROVE(services.uds.session == SW_SESSION_EXTENDED && services.uds.access.unlocked == SW_LEVEL_CALIBRATION);
    while_shut();
    return any_result();
}

sw_store_result sw_store_keep_faults(sw_store *of, const uint8_t *data, uint32_t length)
{
    (void)of, (void)touch(data, length);
    while_shut();
    return any_result();
}

sw_store_result sw_store_keep_failed_attempts(sw_store *of, uint8_t level, uint32_t count)
{
    (void)of, (void)level, (void)count;
    return any_result();
}

uint32_t sw_store_faults(const sw_store *of, uint8_t *data, uint32_t room)
{
    const uint32_t length = nondet_uint();
    (void)of, (void)touch(data, room);
    ASSUME(length <= room);
    return length;
}

uint32_t sw_store_report(const sw_store *of, uint8_t *data)
{
    const uint32_t length = nondet_uint();
    (void)of, (void)data;
    ASSUME(length <= SW_MAX_REPORT);
    return length;
}

static int random_bytes(void *context, uint8_t *bytes, uint32_t count)
{
    (void)context;
    bytes[0] = nondet_uchar();
    bytes[count - 1u] = nondet_uchar();
    return nondet_int();
}

void sw_sha256_of(const uint8_t *data, uint32_t length, uint8_t digest[32])
{
    digest[0] = digest[31] = touch(data, length);
}

void sw_aes_cmac(const uint8_t key[16], const uint8_t *data, uint32_t length, uint8_t mac[16])
{
    mac[0] = mac[15] = (uint8_t)(touch(key, 16) | touch(data, length) | nondet_uchar());
}

uint8_t *sw_isotp_place(sw_isotp *end, uint32_t *room)
{
    (void)end;
    *room = nondet_uint();
    ASSUME(*room <= ROOM);
    return &answers[ROOM - *room]; /* a byte too many is out of bounds */
}

void sw_isotp_send(sw_isotp *end, uint32_t length) { (void)end, (void)length; }

/* --- Any state, any request --- */

static void start(void)
{
    static sw_equipment equipment;
    static uint8_t key[SW_AES_BYTES];
    sw_services any;
    sw_release any_release;
    sw_store_state any_state;
    sw_calibration any_calibration;
    /* Of the other parts, what the services read of them: the solver is quicker with little. */
    store.state = any_state;
    store.wanted = nondet_uint();
    store.verdict = nondet_uchar();
    ecu.calibration = any_calibration;
    equipment.hardware = equipment.serial = equipment.software = "abc";
    equipment.access_key = key;
    equipment.random = random_bytes;
    services = any;
    release = any_release;
    release = any_release;
    sw_services_init(&services, &equipment, &store, &isotp, &ecu);
    ecu.numbers.release = nondet_int() ? &release : NULL;
    store.running = nondet_int() ? (uint8_t)(nondet_uchar() & 1u) : (uint8_t)SW_NO_SLOT;
    store.announced = nondet_int() ? (uint8_t)(nondet_uchar() & 1u) : (uint8_t)SW_NO_SLOT;
    store.state.slots[0].phase = nondet_uchar();
    store.state.slots[1].phase = nondet_uchar();
    isotp.message = message;
    isotp.wanted = (uint16_t)nondet_uint();
    services.uds.session = nondet_uchar();
    services.uds.now_ns = nondet_long();
    services.uds.under_way = NULL;
    ASSUME(services.uds.session >= SW_SESSION_DEFAULT && services.uds.session <= SW_SESSION_EXTENDED);
    ASSUME(services.uds.waiting == 0u && services.transfer.state <= SW_TRANSFER_CLOSED);
    ASSUME(services.uds.now_ns >= 0 && services.uds.now_ns <= ((int64_t)1 << 61));
    ASSUME(services.request.now_ns >= services.request.asked_ns && services.request.asked_ns >= 0);
}

/* The row that the table has, as an object of its own, which keeps its handlers apart from the others. */
static void is_row(const sw_service *service, uint32_t row)
{
    PROVE(rows[row].number == service->number && rows[row].sessions == service->sessions);
    PROVE(rows[row].has_sub_function == service->has_sub_function && rows[row].writes == service->writes);
    PROVE(rows[row].handle == service->handle && rows[row].go_on == service->go_on);
}

/* Requests of one service, and of none: with a table of that one, where `rows` have each number once. */
static void asked(const sw_service *service, uint32_t row, uint32_t most)
{
    static sw_service_table table = {NULL, 1, end_session};
    uint8_t room[REQUEST];
    const uint32_t length = nondet_uint();
    start();
    table.rows = service;
    services.uds.table = &table;
    is_row(service, row);
    ASSUME(length > 0u && length <= most && most <= REQUEST);
    uint8_t *request = &room[REQUEST - length]; /* a byte too many is out of bounds */
    const int64_t now_ns = nondet_long();
    ASSUME(now_ns >= 0 && now_ns <= ((int64_t)1 << 61));
    sw_uds_request(&services.uds, now_ns, request, length, nondet_int());
    PROVE(services.uds.session >= SW_SESSION_DEFAULT && services.uds.session <= SW_SESSION_EXTENDED);
    PROVE(services.transfer.state <= SW_TRANSFER_CLOSED);
    if (services.uds.under_way != NULL) PROVE(services.uds.under_way == service);
}

static const sw_service of_session = {SW_SERVICE_SESSION, SW_IN_ALL, 1, 0, control_session, NULL};
static const sw_service of_reset_asked = {SW_SERVICE_RESET, SW_IN_PROGRAMMING, 1, 0, reset, NULL};
static const sw_service of_faults_cleared = {SW_SERVICE_CLEAR_FAULTS, SW_IN_ALL, 0, 1, clear_faults, NULL};
static const sw_service of_faults_reported = {SW_SERVICE_REPORT_FAULTS, SW_IN_ALL, 1, 0, report_faults, NULL};
static const sw_service of_identifiers = {SW_SERVICE_READ, SW_IN_ALL, 0, 0, read, NULL};
static const sw_service of_access_given = {SW_SERVICE_SECURITY, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 1, 1, give_access, NULL};
static const sw_service of_communication = {SW_SERVICE_COMMUNICATION, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 1, 0, control_communication, NULL};
static const sw_service of_written_values = {SW_SERVICE_WRITE, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 0, 1, write, NULL};
static const sw_service of_routines_begun = {SW_SERVICE_ROUTINE, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 1, 1, routine, routine_on};
static const sw_service of_download_asked = {SW_SERVICE_DOWNLOAD, SW_IN_PROGRAMMING, 0, 0, download, NULL};
static const sw_service of_block_sent = {SW_SERVICE_TRANSFER, SW_IN_PROGRAMMING, 0, 1, take_block, write_on};
static const sw_service of_transfer_ended = {SW_SERVICE_EXIT, SW_IN_PROGRAMMING, 0, 0, end_transfer, NULL};
static const sw_service of_presence = {SW_SERVICE_TESTER_PRESENT, SW_IN_ALL, 1, 0, hear_tester, NULL};
static const sw_service of_fault_setting = {SW_SERVICE_FAULT_SETTING, SW_IN_PROGRAMMING | SW_IN_EXTENDED, 1, 0, set_faults, NULL};

void session(void) { asked(&of_session, 0, 4); }
void reset_asked(void) { asked(&of_reset_asked, 1, 4); }
void faults_cleared(void) { asked(&of_faults_cleared, 2, 6); }
void faults_reported(void) { asked(&of_faults_reported, 3, 8); }
void identifiers(void) { asked(&of_identifiers, 4, 5); }
void access_given(void) { asked(&of_access_given, 5, 20); }
void communication(void) { asked(&of_communication, 6, 4); }
void written_values(void) { asked(&of_written_values, 7, REQUEST); }
void routines_begun(void) { asked(&of_routines_begun, 8, REQUEST); }
void download_asked(void) { asked(&of_download_asked, 9, 13); }
void block_sent(void) { asked(&of_block_sent, 10, REQUEST); }
void transfer_ended(void) { asked(&of_transfer_ended, 11, 3); }
void presence(void) { asked(&of_presence, 12, 4); }
void fault_setting(void) { asked(&of_fault_setting, 13, 4); }

/* A further piece of a routine or of a block, with the response-pending before it. */
static void next_piece_of(const sw_service *service)
{
    static sw_service_table table = {NULL, 1, end_session};
    start();
    table.rows = service;
    services.uds.table = &table;
    services.uds.under_way = service;
    const int64_t now_ns = nondet_long();
    ASSUME(now_ns >= 0 && now_ns <= ((int64_t)1 << 61));
    sw_uds_tick(&services.uds, now_ns);
    PROVE(services.transfer.state <= SW_TRANSFER_CLOSED);
}

void next_of_routine(void) { next_piece_of(&of_routines_begun); }
void next_of_block(void) { next_piece_of(&of_block_sent); }
