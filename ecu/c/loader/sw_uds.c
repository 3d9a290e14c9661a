/* The UDS server: sessions, and one request at a time. */
#include "sw_uds.h"

#include <stddef.h>

#define MS INT64_C(1000000)
#define S3_NS ((int64_t)SW_S3_MS * MS)
/* Response-pending is sent after half of the time limit, so that it is on the bus before the limit ends. */
#define FIRST_PENDING_NS ((int64_t)SW_P2_MS * MS / 2)
#define NEXT_PENDING_NS ((int64_t)SW_P2_EXTENDED_MS * MS / 2)
#define POSITIVE 0x40u
#define NEGATIVE 0x7fu
#define SUPPRESS 0x80u

int sw_uds_is_busy(const sw_uds *uds) { return uds->under_way != NULL || uds->reset_is_due; }

int sw_uds_holds_message(const sw_uds *uds)
{
    return uds->waiting > 0u || (uds->under_way != NULL && uds->under_way->number == SW_SERVICE_TRANSFER);
}

int sw_uds_waits(const sw_uds *uds) { return uds->under_way != NULL && sw_store_is_erasing(uds->store); }

int sw_uds_is_locked(const sw_uds *uds, uint8_t level) { return level != 0u && uds->access.unlocked != level; }

static void see_time(sw_uds *uds, int64_t now_ns)
{
    if (!uds->has_time) sw_access_power_on(&uds->access, uds->store, now_ns);
    if (!uds->has_time || now_ns > uds->now_ns) uds->now_ns = now_ns;
    uds->has_time = 1;
}

void sw_uds_change_session(sw_uds *uds, uint8_t session)
{
    uds->table->end_session(uds->services, session);
    sw_access_lock(&uds->access);
    if (session == SW_SESSION_DEFAULT) uds->is_silent = 0;
    uds->session = session;
    uds->heard_ns = uds->now_ns;
}

void sw_uds_look(sw_uds *uds, int64_t now_ns)
{
    see_time(uds, now_ns);
    if (sw_isotp_is_receiving(uds->isotp) || sw_isotp_is_sending(uds->isotp)) uds->heard_ns = uds->now_ns;
    if (uds->under_way == NULL && uds->session != SW_SESSION_DEFAULT && uds->now_ns - uds->heard_ns >= S3_NS) {
        sw_uds_change_session(uds, SW_SESSION_DEFAULT);
    }
}

static const sw_service *service_of(const sw_uds *uds, uint8_t number)
{
    const sw_service *found = NULL;
    for (uint32_t i = 0; i < uds->table->count; i++) {
        if (uds->table->rows[i].number == number) found = &uds->table->rows[i];
    }
    return found;
}

static void send_negative(sw_uds *uds, uint32_t service, uint32_t code)
{
    sw_answer answer = {0};
    answer.bytes = sw_isotp_place(uds->isotp, &answer.room);
    sw_answer_byte(&answer, NEGATIVE);
    sw_answer_byte(&answer, service);
    sw_answer_byte(&answer, code);
    sw_isotp_send(uds->isotp, answer.length);
}

static void set_up(sw_answer *answer, sw_uds *uds, uint32_t service)
{
    answer->bytes = sw_isotp_place(uds->isotp, &answer->room);
    answer->length = 0;
    sw_answer_byte(answer, service + POSITIVE);
}

/* Returns whether a refusal is not sent after a functional request (ISO 14229-1, section 7.5). */
static int is_unsent(uint8_t code)
{
    return code == SW_NRC_SERVICE_NOT_SUPPORTED || code == SW_NRC_SUB_FUNCTION_NOT_SUPPORTED ||
           code == SW_NRC_OUT_OF_RANGE || code == SW_NRC_SUB_FUNCTION_NOT_IN_SESSION ||
           code == SW_NRC_SERVICE_NOT_IN_SESSION;
}

/* Processes the result code of one part of a request. */
static void came_to(sw_uds *uds, uint8_t number, uint8_t code, const sw_answer *answer)
{
    uds->under_way = code == SW_UDS_MORE ? service_of(uds, number) : NULL;
    if (code == SW_UDS_MORE) return;
    if (code != SW_UDS_DONE) {
        if (!uds->is_functional || !is_unsent(code)) send_negative(uds, number, code);
    } else if (!uds->is_quiet) {
        sw_isotp_send(uds->isotp, answer->length);
    } else {
        /* The tester has suppressed the positive response. */
    }
    uds->heard_ns = uds->now_ns;
}

/* Stores a request until an erasure ends. Refuses it if the buffer is in use for a physical request being received. */
static uint8_t put_off(sw_uds *uds, const uint8_t *request, uint32_t length)
{
    if (uds->isotp->wanted > 0u) return SW_NRC_BUSY_REPEAT_REQUEST;
    for (uint32_t i = 0; i < length; i++) uds->isotp->message[i] = request[i];
    uds->waiting = (uint16_t)length;
    return SW_UDS_MORE;
}

/* Clears the suppress-positive-response bit, then executes the request, or stores it with this bit cleared. */
static uint8_t began(sw_uds *uds, uint8_t *request, uint32_t length, sw_answer *answer)
{
    const sw_service *service = service_of(uds, request[0]);
    if (service == NULL) return SW_NRC_SERVICE_NOT_SUPPORTED;
    if ((service->sessions & 1u << uds->session) == 0u) return SW_NRC_SERVICE_NOT_IN_SESSION;
    if (service->has_sub_function) {
        if (length < 2u) return SW_NRC_INCORRECT_LENGTH;
        uds->is_quiet = (uint8_t)(uds->is_quiet | (request[1] & SUPPRESS));
        request[1] = (uint8_t)(request[1] & ~SUPPRESS);
    }
    if (service->writes && sw_store_is_erasing(uds->store)) return put_off(uds, request, length);
    return service->handle(uds->services, &request[1], length - 1u, answer);
}

/* Continues the request in progress, or begins the waiting request. */
static uint8_t went_on(sw_uds *uds, sw_answer *answer)
{
    const uint32_t length = uds->waiting;
    if (length == 0u) return uds->under_way->go_on(uds->services, answer);
    if (sw_store_is_erasing(uds->store)) return SW_UDS_MORE;
    uds->waiting = 0;
    return began(uds, uds->isotp->message, length, answer);
}

void sw_uds_request(sw_uds *uds, int64_t now_ns, uint8_t *request, uint32_t length, int is_functional)
{
    sw_answer answer;
    see_time(uds, now_ns);
    if (sw_uds_is_busy(uds) || sw_isotp_is_occupied(uds->isotp)) {
        const int is_presence = length == 2u && request[0] == SW_SERVICE_TESTER_PRESENT && request[1] == SUPPRESS;
        if (!is_presence) send_negative(uds, request[0], SW_NRC_BUSY_REPEAT_REQUEST);
        return;
    }
    uds->is_quiet = 0;
    uds->is_functional = (uint8_t)is_functional;
    uds->pending_ns = uds->now_ns + FIRST_PENDING_NS;
    set_up(&answer, uds, request[0]);
    const uint8_t number = request[0];
    const uint8_t code = began(uds, request, length, &answer);
    came_to(uds, number, code, &answer);
}

void sw_uds_tick(sw_uds *uds, int64_t now_ns)
{
    sw_answer answer;
    see_time(uds, now_ns);
    if (uds->reset_is_due) {
        uds->reset_is_due = 0;
        uds->wants_reset = 1;
    }
    if (uds->under_way == NULL) return;
    const uint8_t number = uds->under_way->number;
    if (uds->now_ns >= uds->pending_ns) {
        /* After response-pending the tester waits for an answer, even if the request suppressed a positive response. */
        uds->is_quiet = 0;
        uds->is_functional = 0;
        uds->pending_ns = uds->now_ns + NEXT_PENDING_NS;
        send_negative(uds, number, SW_NRC_RESPONSE_PENDING);
    }
    set_up(&answer, uds, number);
    const uint8_t code = went_on(uds, &answer);
    came_to(uds, number, code, &answer);
}
