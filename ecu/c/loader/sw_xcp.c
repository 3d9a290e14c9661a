/* The XCP slave: a connection, its commands, and the packets that wait to be sent. */
#include "sw_xcp.h"

#if SW_XCP

#include <stddef.h>

typedef struct {
    uint8_t number;
    uint8_t shortest;     /* least number of bytes of the command */
    uint8_t is_protected; /* whether the calibration must be unlocked for the command */
} xcp_command;

static void to_tool(sw_xcp *xcp, const sw_answer *packet)
{
    sw_xcp_packets *waiting = &xcp->waiting;
    sw_bytes_copy(waiting->bytes[waiting->count], packet->bytes, packet->length);
    waiting->lengths[waiting->count] = (uint8_t)packet->length;
    waiting->count++;
}

static void end(sw_xcp *xcp)
{
    xcp->is_connected = 0;
    xcp->has_to_store = 0;
    sw_xcp_access_lock(&xcp->access);
    sw_xcp_memory_end(&xcp->memory);
    sw_daq_free(&xcp->daq);
}

static uint8_t resources(const sw_xcp *xcp) { return (uint8_t)(xcp->access.is_unlocked ? 0u : SW_XCP_CAL_PAG); }

static void connect(sw_xcp *xcp, sw_answer *answer)
{
    static const uint8_t what[] = {SW_XCP_RESOURCES, SW_XCP_COMM_MODE, SW_XCP_MAX_CTO, SW_XCP_MAX_CTO, 0,
                                   SW_XCP_PROTOCOL_VERSION, SW_XCP_TRANSPORT_VERSION};
    end(xcp);
    xcp->is_connected = 1;
    sw_answer_bytes(answer, what, sizeof what);
}

static uint8_t status(const sw_xcp *xcp, sw_answer *answer)
{
    const uint32_t store = xcp->has_to_store ? SW_XCP_STORE_REQUEST : 0u;
    sw_answer_byte(answer, store | (xcp->daq.is_running ? SW_XCP_DAQ_RUNNING : 0u));
    sw_answer_byte(answer, resources(xcp));
    for (uint32_t i = 0; i < 3u; i++) sw_answer_byte(answer, 0);
    return SW_XCP_DONE;
}

static uint8_t comm_mode_info(sw_answer *answer)
{
    for (uint32_t i = 0; i < 6u; i++) sw_answer_byte(answer, 0);
    sw_answer_byte(answer, SW_XCP_DRIVER_VERSION);
    return SW_XCP_DONE;
}

static uint8_t set_request(sw_xcp *xcp, const uint8_t *data)
{
    if (data[1] != SW_XCP_STORE_REQUEST) return SW_XCP_ERROR_OUT_OF_RANGE;
    xcp->has_to_store = 1;
    xcp->to_store = *sw_calibrating_in_force(xcp->memory.calibrating);
    return SW_XCP_DONE;
}

static uint8_t measuring(sw_xcp *xcp, const uint8_t *data, sw_answer *answer)
{
    static const char name[] = SW_XCP_EVENT_NAME;
    const uint8_t code = sw_daq_command(&xcp->daq, data, answer);
    if (code == SW_XCP_DONE && data[0] == SW_XCP_GET_DAQ_EVENT_INFO) sw_xcp_memory_text(&xcp->memory, name, sizeof name - 1u);
    return code;
}

static uint8_t handled(sw_xcp *xcp, const uint8_t *data, uint32_t length, sw_answer *answer)
{
    uint8_t code = SW_XCP_DONE;
    switch (data[0]) {
    case SW_XCP_DISCONNECT:
        end(xcp);
        break;
    case SW_XCP_GET_STATUS:
        code = status(xcp, answer);
        break;
    case SW_XCP_SYNCH:
        code = SW_XCP_ERROR_CMD_SYNCH;
        break;
    case SW_XCP_GET_COMM_MODE_INFO:
        code = comm_mode_info(answer);
        break;
    case SW_XCP_SET_REQUEST:
        code = set_request(xcp, data);
        break;
    case SW_XCP_GET_SEED:
        code = sw_xcp_access_seed(&xcp->access, data, xcp->random, xcp->context, answer);
        break;
    case SW_XCP_UNLOCK:
        code = sw_xcp_access_unlock(&xcp->access, data, length, xcp->access_key);
        if (code == SW_XCP_ERROR_ACCESS_LOCKED) end(xcp);
        if (code == SW_XCP_DONE) sw_answer_byte(answer, resources(xcp));
        break;
    default:
        code = data[0] <= SW_XCP_SET_DAQ_PTR ? measuring(xcp, data, answer)
                                             : sw_xcp_memory_command(&xcp->memory, data, length, answer);
        break;
    }
    return code;
}

/* Checks a command's length and its permission, and executes it. */
static uint8_t answered(sw_xcp *xcp, const uint8_t *data, uint32_t length, sw_answer *answer)
{
    static const xcp_command commands[] = SW_XCP_COMMANDS;
    for (uint32_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        if (commands[i].number != data[0]) continue;
        if (length < commands[i].shortest) return SW_XCP_ERROR_CMD_SYNTAX;
        if (commands[i].is_protected && !xcp->access.is_unlocked) return SW_XCP_ERROR_ACCESS_LOCKED;
        return handled(xcp, data, length, answer);
    }
    return SW_XCP_ERROR_CMD_UNKNOWN;
}

/* Ends an idle connection. While a tool is measuring, only locks the calibration. */
static void end_if_idle(sw_xcp *xcp, int64_t now_ns)
{
    if (!xcp->is_connected || now_ns - xcp->last_ns <= SW_XCP_IDLE_NS) return;
    if (xcp->daq.is_running) {
        xcp->has_to_store = 0;
        sw_xcp_access_lock(&xcp->access);
    } else {
        end(xcp);
    }
}

void sw_xcp_init(sw_xcp *xcp, sw_calibrating *calibrating, const uint8_t *access_key, sw_random random, void *context)
{
    xcp->access_key = access_key;
    xcp->random = random;
    xcp->context = context;
    xcp->memory.calibrating = calibrating;
    xcp->memory.daq = &xcp->daq;
}

int sw_xcp_is_command(const sw_frame *frame)
{
    return frame->id == SW_XCP_COMMAND_ID && frame->is_extended == SW_XCP_EXTENDED && frame->length > 0u;
}

void sw_xcp_command(sw_xcp *xcp, int64_t now_ns, const sw_frame *frame)
{
    uint8_t bytes[SW_XCP_MAX_CTO];
    sw_answer answer = {bytes, sizeof bytes, 0};
    uint8_t code = SW_XCP_DONE;
    const int is_connect = frame->data[0] == SW_XCP_CONNECT;
    if (xcp->waiting.count == SW_XCP_PLACES) return;
    end_if_idle(xcp, now_ns);
    if (!is_connect && !xcp->is_connected) return;
    xcp->last_ns = now_ns;
    sw_answer_byte(&answer, SW_XCP_RESPONSE);
    if (!is_connect) {
        code = answered(xcp, frame->data, frame->length, &answer);
    } else if (frame->length < SW_XCP_CONNECT_BYTES) {
        code = SW_XCP_ERROR_CMD_SYNTAX;
    } else {
        connect(xcp, &answer);
    }
    if (code != SW_XCP_DONE) {
        answer.length = 0;
        sw_answer_byte(&answer, SW_XCP_ERROR);
        sw_answer_byte(&answer, code);
    }
    to_tool(xcp, &answer);
}

void sw_xcp_look(sw_xcp *xcp, int64_t now_ns, int may_store)
{
    uint8_t event[] = {SW_XCP_EVENT, SW_XCP_STORED_EVENT};
    const sw_answer stored = {event, sizeof event, sizeof event};
    end_if_idle(xcp, now_ns);
    if (!xcp->has_to_store || !may_store || xcp->waiting.count == SW_XCP_PLACES) return;
    const uint8_t code = sw_calibrating_store(xcp->memory.calibrating, &xcp->to_store);
    if (code == SW_NRC_CONDITIONS_NOT_CORRECT) return; /* the request waits until the jets are shut */
    /* A failed attempt is not repeated: an attempt in every period would wear out a failing memory. */
    xcp->has_to_store = 0;
    if (code == SW_UDS_DONE) to_tool(xcp, &stored);
}

static void to_bus(const uint8_t *packet, uint32_t length, int64_t now_ns, sw_frame *frame)
{
    sw_bytes_copy(frame->data, packet, length);
    frame->length = (uint8_t)length;
    frame->timestamp_ns = now_ns;
    frame->id = SW_XCP_RESPONSE_ID;
    frame->is_extended = SW_XCP_EXTENDED;
    frame->is_fd = SW_FRAMES_FD;
}

int sw_xcp_poll(sw_xcp *xcp, int64_t now_ns, int room, sw_frame *frames)
{
    sw_xcp_packets *waiting = &xcp->waiting;
    uint8_t packet[SW_XCP_MAX_CTO];
    uint32_t answers = 0;
    int sent = 0;
    while (sent < room && answers < waiting->count) {
        to_bus(waiting->bytes[answers], waiting->lengths[answers], now_ns, &frames[sent]);
        answers++;
        sent++;
    }
    waiting->count = (uint8_t)(waiting->count - answers);
    for (uint32_t i = 0; i < waiting->count; i++) {
        waiting->lengths[i] = waiting->lengths[i + answers];
        sw_bytes_copy(waiting->bytes[i], waiting->bytes[i + answers], waiting->lengths[i]);
    }
    while (sent < room) {
        const uint32_t length = sw_daq_packet(&xcp->daq, packet);
        if (length == 0u) break;
        to_bus(packet, length, now_ns, &frames[sent]);
        sent++;
    }
    return sent;
}

int sw_xcp_is_sending(const sw_xcp *xcp) { return xcp->waiting.count > 0u || xcp->daq.next < xcp->daq.odts; }

#endif
