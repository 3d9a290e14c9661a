/* The XCP slave: a connection, seed and key, the calibration's pages. */
#include "sw_xcp.h"

#if SW_XCP

#include <stddef.h>

#include "sw_records.h"

#define PIECE (SW_XCP_MAX_CTO - 2u) /* bytes of a seed or a key in a packet */

typedef struct {
    uint8_t number;
    uint8_t shortest; /* bytes */
    uint8_t is_protected; /* needs the calibration unlocked */
} xcp_command;

static void put(sw_answer *answer, uint32_t value)
{
    for (uint32_t i = 0; i < 4u; i++) sw_answer_byte(answer, value >> (8u * i) & 0xffu);
}

static uint32_t number(const uint8_t *data)
{
    return data[0] | (uint32_t)data[1] << 8 | (uint32_t)data[2] << 16 | (uint32_t)data[3] << 24;
}

static void to_tool(sw_xcp *xcp, const sw_answer *packet)
{
    sw_xcp_packets *waiting = &xcp->waiting;
    sw_bytes_copy(waiting->bytes[waiting->count], packet->bytes, packet->length);
    waiting->lengths[waiting->count] = (uint8_t)packet->length;
    waiting->count++;
}

/* --- Seed and key --- */

static void forget(sw_xcp_access *access)
{
    access->has_seed = 0;
    access->unsent = 0;
    access->key_bytes = 0;
}

static uint8_t resources(const sw_xcp *xcp) { return (uint8_t)(xcp->access.is_unlocked ? 0u : SW_XCP_CAL_PAG); }

static uint8_t begin_seed(sw_xcp *xcp, uint32_t resource)
{
    sw_xcp_access *access = &xcp->access;
    uint32_t any = 0;
    forget(access);
    if (resource != SW_XCP_CAL_PAG) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (access->is_unlocked) return SW_XCP_DONE;
    if (xcp->random(xcp->context, access->seed, SW_XCP_SEED_LENGTH) != 0) return SW_XCP_ERROR_GENERIC;
    for (uint32_t i = 0; i < SW_XCP_SEED_LENGTH; i++) any |= access->seed[i];
    if (any == 0u) return SW_XCP_ERROR_GENERIC;
    access->has_seed = 1;
    access->unsent = SW_XCP_SEED_LENGTH;
    return SW_XCP_DONE;
}

static uint8_t get_seed(sw_xcp *xcp, const uint8_t *data, sw_answer *answer)
{
    sw_xcp_access *access = &xcp->access;
    uint8_t code = SW_XCP_DONE;
    if (data[1] == 0u) {
        code = begin_seed(xcp, data[2]);
    } else if (data[1] != 1u) {
        code = SW_XCP_ERROR_OUT_OF_RANGE;
    } else if (access->unsent == 0u) {
        code = SW_XCP_ERROR_SEQUENCE;
    } else {
        /* The rest of it. */
    }
    if (code != SW_XCP_DONE) return code;
    const uint32_t piece = access->unsent < PIECE ? access->unsent : PIECE;
    sw_answer_byte(answer, access->unsent);
    sw_answer_bytes(answer, &access->seed[SW_XCP_SEED_LENGTH - access->unsent], piece);
    access->unsent = (uint8_t)(access->unsent - piece);
    return SW_XCP_DONE;
}

static void end(sw_xcp *xcp)
{
    xcp->is_connected = 0;
    xcp->has_to_store = 0;
    xcp->access.is_unlocked = 0;
    forget(&xcp->access);
    xcp->address = 0;
    xcp->text_bytes = 0;
    xcp->page = SW_PAGE_WORKING;
    sw_daq_free(&xcp->daq);
}

/* Another try needs another seed; a wrong key ends the connection. */
static uint8_t unlock(sw_xcp *xcp, const uint8_t *data, uint32_t length, sw_answer *answer)
{
    sw_xcp_access *access = &xcp->access;
    const uint32_t left = data[1];
    const uint32_t piece = left < PIECE ? left : PIECE;
    if (!access->has_seed || access->unsent > 0u || left != (uint32_t)SW_ANSWER_BYTES - access->key_bytes) {
        forget(access);
        return SW_XCP_ERROR_SEQUENCE;
    }
    if (length - 2u < piece) return SW_XCP_ERROR_CMD_SYNTAX;
    sw_bytes_copy(&access->key[access->key_bytes], &data[2], piece);
    access->key_bytes = (uint8_t)(access->key_bytes + piece);
    if (access->key_bytes == SW_ANSWER_BYTES) {
        uint8_t right[SW_ANSWER_BYTES];
        sw_access_answer(SW_LEVEL_CALIBRATION, xcp->access_key, access->seed, SW_XCP_SEED_LENGTH, right);
        forget(access);
        if (!sw_bytes_equal(right, access->key, SW_ANSWER_BYTES)) {
            end(xcp);
            return SW_XCP_ERROR_ACCESS_LOCKED;
        }
        access->is_unlocked = 1;
    }
    sw_answer_byte(answer, resources(xcp));
    return SW_XCP_DONE;
}

/* --- Memory --- */

static int is_inside(uint32_t address, uint32_t length, uint32_t start, uint32_t size)
{
    return address >= start && address - start <= size && length <= size - (address - start);
}

/* Copies what a tool sees there, sizeof(sw_measured) bytes at most. */
static uint8_t read(const sw_xcp *xcp, uint32_t address, uint32_t length, uint8_t *bytes)
{
    if (is_inside(address, length, SW_XCP_MEASURED, sizeof(sw_measured))) {
        sw_bytes_copy(bytes, &((const uint8_t *)&xcp->daq.measured)[address - SW_XCP_MEASURED], length);
        return SW_XCP_DONE;
    }
    if (!is_inside(address, length, SW_XCP_ADDRESS, sizeof(sw_calibration))) return SW_XCP_ERROR_ACCESS_DENIED;
    sw_calibrating_bytes(xcp->calibrating, xcp->page, address - SW_XCP_ADDRESS, length, bytes);
    return SW_XCP_DONE;
}

static void set_text(sw_xcp *xcp, const char *text, uint32_t bytes)
{
    xcp->text = text;
    xcp->text_bytes = (uint8_t)bytes;
}

static uint8_t get_id(sw_xcp *xcp, const uint8_t *data, sw_answer *answer)
{
    static const char name[] = SW_XCP_A2L_NAME;
    set_text(xcp, name, data[1] <= 1u ? sizeof name - 1u : 0u); /* as text, or the file's name */
    for (uint32_t i = 0; i < 3u; i++) sw_answer_byte(answer, 0);
    put(answer, xcp->text_bytes);
    return SW_XCP_DONE;
}

static uint8_t set_mta(sw_xcp *xcp, const uint8_t *data)
{
    if (data[3] != 0u) return SW_XCP_ERROR_OUT_OF_RANGE;
    xcp->address = number(&data[4]);
    xcp->text_bytes = 0;
    return SW_XCP_DONE;
}

static int is_length(uint32_t length, uint32_t most) { return length > 0u && length <= most; }

static uint8_t upload(sw_xcp *xcp, const uint8_t *data, sw_answer *answer)
{
    uint8_t bytes[SW_XCP_MAX_CTO];
    const uint32_t length = data[1];
    if (!is_length(length, SW_XCP_MAX_CTO - 1u)) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (xcp->text_bytes > 0u) {
        const uint32_t piece = length < xcp->text_bytes ? length : xcp->text_bytes;
        for (uint32_t i = 0; i < piece; i++) sw_answer_byte(answer, (uint8_t)xcp->text[i]);
        set_text(xcp, &xcp->text[piece], xcp->text_bytes - piece);
        return SW_XCP_DONE;
    }
    const uint8_t code = read(xcp, xcp->address, length, bytes);
    if (code != SW_XCP_DONE) return code;
    sw_answer_bytes(answer, bytes, length);
    xcp->address += length;
    return SW_XCP_DONE;
}

static uint8_t short_upload(sw_xcp *xcp, const uint8_t *data, sw_answer *answer)
{
    uint8_t bytes[SW_XCP_MAX_CTO];
    const uint32_t length = data[1];
    const uint32_t address = number(&data[4]);
    if (!is_length(length, SW_XCP_MAX_CTO - 1u) || data[3] != 0u) return SW_XCP_ERROR_OUT_OF_RANGE;
    const uint8_t code = read(xcp, address, length, bytes);
    if (code != SW_XCP_DONE) return code;
    sw_answer_bytes(answer, bytes, length);
    xcp->text_bytes = 0;
    xcp->address = address + length;
    return SW_XCP_DONE;
}

static uint8_t build_checksum(sw_xcp *xcp, const uint8_t *data, sw_answer *answer)
{
    uint8_t bytes[sizeof(sw_measured)];
    const uint32_t length = number(&data[4]);
    const uint8_t code = read(xcp, xcp->address, length, bytes);
    if (code != SW_XCP_DONE) return code;
    sw_answer_byte(answer, SW_XCP_CRC_32);
    sw_answer_byte(answer, 0);
    sw_answer_byte(answer, 0);
    put(answer, sw_crc32(0, bytes, length));
    xcp->address += length;
    return SW_XCP_DONE;
}

static uint8_t download(sw_xcp *xcp, const uint8_t *data, uint32_t length)
{
    const uint32_t count = data[1];
    if (!is_length(count, SW_XCP_MAX_CTO - 2u)) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (length < 2u + count) return SW_XCP_ERROR_CMD_SYNTAX;
    if (!is_inside(xcp->address, count, SW_XCP_ADDRESS, sizeof(sw_calibration))) return SW_XCP_ERROR_ACCESS_DENIED;
    if (xcp->page != SW_PAGE_WORKING) return SW_XCP_ERROR_WRITE_PROTECTED;
    if (!sw_calibrating_write_bytes(xcp->calibrating, xcp->address - SW_XCP_ADDRESS, &data[2], count)) {
        return SW_XCP_ERROR_OUT_OF_RANGE;
    }
    xcp->address += count;
    return SW_XCP_DONE;
}

/* --- Pages --- */

static uint8_t segment_refusal(uint32_t segment)
{
    return segment == 0u ? SW_XCP_DONE : SW_XCP_ERROR_SEGMENT_NOT_VALID;
}

static uint8_t page_refusal(uint32_t page)
{
    return page <= SW_PAGE_REFERENCE ? SW_XCP_DONE : SW_XCP_ERROR_PAGE_NOT_VALID;
}

static uint8_t set_page(sw_xcp *xcp, const uint8_t *data)
{
    const uint32_t mode = data[1];
    uint8_t code = SW_XCP_DONE;
    if ((mode & (SW_XCP_ECU_MODE | SW_XCP_XCP_MODE)) == 0u) return SW_XCP_ERROR_MODE_NOT_VALID;
    if ((mode & SW_XCP_ALL_MODE) == 0u) code = segment_refusal(data[2]);
    if (code == SW_XCP_DONE) code = page_refusal(data[3]);
    if (code != SW_XCP_DONE) return code;
    if ((mode & SW_XCP_ECU_MODE) != 0u) sw_calibrating_select(xcp->calibrating, data[3]);
    if ((mode & SW_XCP_XCP_MODE) != 0u) xcp->page = data[3];
    return SW_XCP_DONE;
}

static uint8_t get_page(const sw_xcp *xcp, const uint8_t *data, sw_answer *answer)
{
    if (data[1] != SW_XCP_ECU_MODE && data[1] != SW_XCP_XCP_MODE) return SW_XCP_ERROR_MODE_NOT_VALID;
    const uint8_t code = segment_refusal(data[2]);
    if (code != SW_XCP_DONE) return code;
    sw_answer_byte(answer, 0);
    sw_answer_byte(answer, 0);
    sw_answer_byte(answer, data[1] == SW_XCP_ECU_MODE ? xcp->calibrating->page : xcp->page);
    return SW_XCP_DONE;
}

static uint8_t segment_info(const uint8_t *data, sw_answer *answer)
{
    static const uint8_t pages[] = {SW_PAGE_REFERENCE + 1u, 0, 0, 0, 0};
    const uint8_t code = segment_refusal(data[2]);
    if (code != SW_XCP_DONE) return code;
    if (data[1] == 0u && data[3] <= 1u) {
        for (uint32_t i = 0; i < 3u; i++) sw_answer_byte(answer, 0);
        put(answer, data[3] == 0u ? SW_XCP_ADDRESS : (uint32_t)sizeof(sw_calibration));
        return SW_XCP_DONE;
    }
    if (data[1] != 1u) return SW_XCP_ERROR_OUT_OF_RANGE;
    sw_answer_bytes(answer, pages, sizeof pages);
    return SW_XCP_DONE;
}

static uint8_t page_info(const uint8_t *data, sw_answer *answer)
{
    uint8_t code = segment_refusal(data[2]);
    if (code == SW_XCP_DONE) code = page_refusal(data[3]);
    if (code != SW_XCP_DONE) return code;
    sw_answer_byte(answer, data[3] == SW_PAGE_WORKING ? SW_XCP_WORKING_PROPERTIES : SW_XCP_REFERENCE_PROPERTIES);
    sw_answer_byte(answer, 0);
    return SW_XCP_DONE;
}

static uint8_t copy_page(sw_xcp *xcp, const uint8_t *data)
{
    uint8_t code = segment_refusal(data[1]);
    if (code == SW_XCP_DONE) code = segment_refusal(data[3]);
    if (code == SW_XCP_DONE) code = page_refusal(data[2]);
    if (code == SW_XCP_DONE) code = page_refusal(data[4]);
    if (code != SW_XCP_DONE) return code;
    if (data[4] == SW_PAGE_REFERENCE) return SW_XCP_ERROR_WRITE_PROTECTED;
    if (data[2] == SW_PAGE_REFERENCE) sw_calibrating_copy_release(xcp->calibrating);
    return SW_XCP_DONE;
}

/* --- The connection --- */

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

static uint8_t page_processor_info(sw_answer *answer)
{
    sw_answer_byte(answer, 1); /* segment, without properties */
    sw_answer_byte(answer, 0);
    return SW_XCP_DONE;
}

static uint8_t set_request(sw_xcp *xcp, const uint8_t *data)
{
    if (data[1] != SW_XCP_STORE_REQUEST) return SW_XCP_ERROR_OUT_OF_RANGE;
    xcp->has_to_store = 1;
    xcp->to_store = *sw_calibrating_in_force(xcp->calibrating);
    return SW_XCP_DONE;
}

static uint8_t measuring(sw_xcp *xcp, const uint8_t *data, sw_answer *answer)
{
    static const char name[] = SW_XCP_EVENT_NAME;
    const uint8_t code = sw_daq_command(&xcp->daq, data, answer);
    if (code == SW_XCP_DONE && data[0] == SW_XCP_GET_DAQ_EVENT_INFO) set_text(xcp, name, sizeof name - 1u);
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
    case SW_XCP_GET_ID:
        code = get_id(xcp, data, answer);
        break;
    case SW_XCP_SET_REQUEST:
        code = set_request(xcp, data);
        break;
    case SW_XCP_GET_SEED:
        code = get_seed(xcp, data, answer);
        break;
    case SW_XCP_UNLOCK:
        code = unlock(xcp, data, length, answer);
        break;
    case SW_XCP_SET_MTA:
        code = set_mta(xcp, data);
        break;
    case SW_XCP_UPLOAD:
        code = upload(xcp, data, answer);
        break;
    case SW_XCP_SHORT_UPLOAD:
        code = short_upload(xcp, data, answer);
        break;
    case SW_XCP_BUILD_CHECKSUM:
        code = build_checksum(xcp, data, answer);
        break;
    case SW_XCP_DOWNLOAD:
        code = download(xcp, data, length);
        break;
    case SW_XCP_SET_CAL_PAGE:
        code = set_page(xcp, data);
        break;
    case SW_XCP_GET_CAL_PAGE:
        code = get_page(xcp, data, answer);
        break;
    case SW_XCP_GET_PAG_PROCESSOR_INFO:
        code = page_processor_info(answer);
        break;
    case SW_XCP_GET_SEGMENT_INFO:
        code = segment_info(data, answer);
        break;
    case SW_XCP_GET_PAGE_INFO:
        code = page_info(data, answer);
        break;
    case SW_XCP_COPY_CAL_PAGE:
        code = copy_page(xcp, data);
        break;
    default:
        code = measuring(xcp, data, answer);
        break;
    }
    return code;
}

/* Checks a command's length and whether it needs a key, and has it done. */
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

/* Ends a connection that is left alone; that of a tool that measures lasts, locked. */
static void end_if_idle(sw_xcp *xcp, int64_t now_ns)
{
    if (!xcp->is_connected || now_ns - xcp->last_ns <= SW_XCP_IDLE_NS) return;
    if (xcp->daq.is_running) {
        xcp->has_to_store = 0;
        xcp->access.is_unlocked = 0;
        forget(&xcp->access);
    } else {
        end(xcp);
    }
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
    const uint8_t code = sw_calibrating_store(xcp->calibrating, &xcp->to_store);
    if (code == SW_NRC_CONDITIONS_NOT_CORRECT) return; /* until the jets are shut */
    /* To try again in every period would wear out a memory that fails. */
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
