/* The UDS server: sessions, and one request at a time. */
#include "sw_uds.h"

#include "sw_node.h"

#define MS INT64_C(1000000)
#define S3_NS ((int64_t)SW_S3_MS * MS)
/* Half the limits, which are for the last moment on the bus. */
#define FIRST_PENDING_NS ((int64_t)SW_P2_MS * MS / 2)
#define NEXT_PENDING_NS ((int64_t)SW_P2_EXTENDED_MS * MS / 2)
#define POSITIVE 0x40u
#define NEGATIVE 0x7fu
#define SUPPRESS 0x80u

void sw_uds_init(sw_uds *uds)
{
    uint8_t *bytes = (uint8_t *)uds;
    for (size_t i = 0; i < sizeof *uds; i++) bytes[i] = 0;
    uds->session = SW_SESSION_DEFAULT;
}

int sw_uds_is_busy(const sw_uds *uds) { return uds->service != 0u || uds->reset_is_due; }

int sw_uds_holds_message(const sw_uds *uds) { return uds->waiting > 0u || uds->service == SW_SERVICE_TRANSFER; }

int sw_uds_waits(const sw_node *node) { return node->uds.service != 0u && sw_store_is_erasing(&node->store); }

int sw_uds_is_locked(const sw_node *node, uint8_t level) { return level != 0u && node->access.unlocked != level; }

static void see_time(sw_node *node, int64_t now_ns)
{
    sw_uds *uds = &node->uds;
    if (!uds->has_time) sw_access_power_on(&node->access, &node->store, now_ns);
    if (!uds->has_time || now_ns > uds->now_ns) uds->now_ns = now_ns;
    uds->has_time = 1;
}

void sw_uds_change_session(sw_node *node, int64_t now_ns, uint8_t session)
{
    sw_uds *uds = &node->uds;
    if (uds->session != SW_SESSION_DEFAULT) sw_programming_leave(node);
    if (session == SW_SESSION_DEFAULT) {
        uds->is_silent = 0;
        node->faults.is_off = 0;
    }
    sw_access_lock(&node->access);
    uds->transfer.state = SW_NO_TRANSFER;
    uds->session = session;
    uds->heard_ns = now_ns;
}

static void end_silent_session(sw_node *node)
{
    const sw_uds *uds = &node->uds;
    if (uds->service == 0u && uds->session != SW_SESSION_DEFAULT && uds->now_ns - uds->heard_ns >= S3_NS) {
        sw_uds_change_session(node, uds->now_ns, SW_SESSION_DEFAULT);
    }
}

void sw_uds_look(sw_node *node, int64_t now_ns)
{
    see_time(node, now_ns);
    if (sw_isotp_is_receiving(&node->isotp) || sw_isotp_is_sending(&node->isotp)) node->uds.heard_ns = node->uds.now_ns;
    end_silent_session(node);
}

static void send_negative(sw_node *node, uint32_t service, uint32_t code)
{
    sw_answer answer = {0};
    answer.bytes = sw_isotp_place(&node->isotp, &answer.room);
    sw_answer_byte(&answer, NEGATIVE);
    sw_answer_byte(&answer, service);
    sw_answer_byte(&answer, code);
    sw_isotp_send(&node->isotp, answer.length);
}

static void set_up(sw_answer *answer, sw_node *node, uint32_t service)
{
    answer->bytes = sw_isotp_place(&node->isotp, &answer->room);
    answer->length = 0;
    sw_answer_byte(answer, service + POSITIVE);
}

/* A refusal that an ECU does not send to a functional request (ISO 14229-1, section 7.5). */
static int is_unsent(uint8_t code)
{
    return code == SW_NRC_SERVICE_NOT_SUPPORTED || code == SW_NRC_SUB_FUNCTION_NOT_SUPPORTED ||
           code == SW_NRC_OUT_OF_RANGE || code == SW_NRC_SUB_FUNCTION_NOT_IN_SESSION ||
           code == SW_NRC_SERVICE_NOT_IN_SESSION;
}

/* What a piece of a request came to. */
static void came_to(sw_node *node, uint8_t service, uint8_t code, const sw_answer *answer)
{
    sw_uds *uds = &node->uds;
    uds->service = code == SW_UDS_MORE ? service : 0u;
    if (code == SW_UDS_MORE) return;
    if (code != SW_UDS_DONE) {
        if (!uds->is_functional || !is_unsent(code)) send_negative(node, service, code);
    } else if (!uds->is_quiet) {
        sw_isotp_send(&node->isotp, answer->length);
    } else {
        /* The tester wants no answer. */
    }
    uds->heard_ns = uds->now_ns;
}

static uint8_t waited(sw_node *node, sw_answer *answer);

/* A request that cannot begin yet is kept where no other one comes; one to every ECU must not take the place of one that
 * is on its way to this.
 */
static uint8_t put_off(sw_node *node, const uint8_t *request, uint32_t length)
{
    if (node->isotp.wanted > 0u) return SW_NRC_BUSY_REPEAT_REQUEST;
    for (uint32_t i = 0; i < length; i++) node->isotp.message[i] = request[i];
    node->uds.waiting = (uint16_t)length;
    node->uds.work = waited;
    return SW_UDS_MORE;
}

/* The first piece of a request; the bit that suppresses its answer is taken off. */
static uint8_t began(sw_node *node, uint8_t *request, uint32_t length, sw_answer *answer)
{
    const sw_service *service = sw_service_of(request[0]);
    if (service == NULL) return SW_NRC_SERVICE_NOT_SUPPORTED;
    if ((service->sessions & 1u << node->uds.session) == 0u) return SW_NRC_SERVICE_NOT_IN_SESSION;
    if (service->writes && sw_store_is_erasing(&node->store)) return put_off(node, request, length);
    if (service->has_sub_function) {
        if (length < 2u) return SW_NRC_INCORRECT_LENGTH;
        node->uds.is_quiet = (uint8_t)((request[1] & SUPPRESS) != 0u);
        request[1] = (uint8_t)(request[1] & ~SUPPRESS);
    }
    return service->handle(node, &request[1], length - 1u, answer);
}

static uint8_t waited(sw_node *node, sw_answer *answer)
{
    const uint32_t length = node->uds.waiting;
    if (sw_store_is_erasing(&node->store)) return SW_UDS_MORE;
    node->uds.waiting = 0;
    return began(node, node->isotp.message, length, answer);
}

void sw_uds_request(sw_node *node, int64_t now_ns, uint8_t *request, uint32_t length, int is_functional)
{
    sw_uds *uds = &node->uds;
    sw_answer answer;
    see_time(node, now_ns);
    if (sw_uds_is_busy(uds) || sw_isotp_is_occupied(&node->isotp)) {
        const int is_presence = length == 2u && request[0] == SW_SERVICE_TESTER_PRESENT && request[1] == SUPPRESS;
        if (!is_presence) send_negative(node, request[0], SW_NRC_BUSY_REPEAT_REQUEST);
        return;
    }
    uds->is_quiet = 0;
    uds->is_functional = (uint8_t)is_functional;
    uds->pending_ns = uds->now_ns + FIRST_PENDING_NS;
    set_up(&answer, node, request[0]);
    const uint8_t service = request[0];
    const uint8_t code = began(node, request, length, &answer);
    came_to(node, service, code, &answer);
}

void sw_uds_tick(sw_node *node, int64_t now_ns)
{
    sw_uds *uds = &node->uds;
    sw_answer answer;
    see_time(node, now_ns);
    if (uds->reset_is_due) {
        uds->reset_is_due = 0;
        node->wants_reset = 1;
    }
    if (uds->service == 0u) return;
    if (uds->now_ns >= uds->pending_ns) {
        /* A tester that received response-pending waits for the answer, even if it wanted none. */
        uds->is_quiet = 0;
        uds->is_functional = 0;
        uds->pending_ns = uds->now_ns + NEXT_PENDING_NS;
        send_negative(node, uds->service, SW_NRC_RESPONSE_PENDING);
    }
    set_up(&answer, node, uds->service);
    const uint8_t code = uds->work(node, &answer);
    came_to(node, uds->service, code, &answer);
}
