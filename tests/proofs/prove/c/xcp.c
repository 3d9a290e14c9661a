/* XCP: any packet in any state of the connection, over a memory and a measurement that answer anything (memory.c, daq.c).
 */
#include "sw_uds_settings.h"
#undef SW_XCP_PLACES
#define SW_XCP_PLACES 2u

#include "bytes_model.h"

#include "sw_xcp.c"
#include "sw_xcp_access.c"

static sw_xcp xcp;
static sw_calibrating calibrating;
static int may_store;

static uint8_t any_answer(sw_answer *answer)
{
    const uint32_t length = nondet_uint();
    ASSUME(answer->length == 1u && length >= 1u && length <= SW_XCP_MAX_CTO);
    answer->length = length;
    return nondet_uchar();
}

uint8_t sw_xcp_memory_command(sw_xcp_memory *memory, const uint8_t *data, uint32_t length, sw_answer *answer)
{
    (void)memory, (void)touch(data, length < SW_XCP_MAX_CTO ? length : SW_XCP_MAX_CTO);
    if (data[0] == SW_XCP_DOWNLOAD || data[0] == SW_XCP_SET_CAL_PAGE || data[0] == SW_XCP_COPY_CAL_PAGE) {
        PROVE(xcp.access.is_unlocked);
    }
    return any_answer(answer);
}

uint8_t sw_daq_command(sw_daq *daq, const uint8_t *data, sw_answer *answer) { return (void)daq, (void)data, any_answer(answer); }
void sw_daq_free(sw_daq *daq) { daq->odts = daq->next = daq->is_running = 0; }
void sw_xcp_memory_end(sw_xcp_memory *memory) { memory->text_bytes = 0; }
void sw_xcp_memory_text(sw_xcp_memory *memory, const char *text, uint32_t bytes) { (void)memory, (void)text[bytes - 1u]; }

uint32_t sw_daq_packet(sw_daq *daq, uint8_t *packet)
{
    const uint32_t length = nondet_uint();
    ASSUME(length <= SW_XCP_MAX_CTO);
    packet[0] = packet[SW_XCP_MAX_CTO - 1u] = nondet_uchar();
    return (void)daq, length;
}

const sw_calibration *sw_calibrating_in_force(const sw_calibrating *of) { return &of->working; }

uint8_t sw_calibrating_store(sw_calibrating *of, const sw_calibration *values)
{
    (void)of, (void)values;
    PROVE(may_store && xcp.is_connected);
    return nondet_uchar();
}

static int is_right; /* the key */

void sw_access_answer(uint8_t level, const uint8_t key[SW_AES_BYTES], const uint8_t *seed, uint32_t length,
                      uint8_t answer[SW_ANSWER_BYTES])
{
    PROVE(level == SW_LEVEL_CALIBRATION);
    answer[0] = answer[SW_ANSWER_BYTES - 1] = (uint8_t)(touch(key, SW_AES_BYTES) | touch(seed, length));
    is_right = 1;
}

static int random_bytes(void *context, uint8_t *bytes, uint32_t count)
{
    (void)context;
    bytes[0] = bytes[count - 1u] = nondet_uchar();
    return nondet_int();
}

static int is_sound(void)
{
    const sw_xcp_access *access = &xcp.access;
    int sound = xcp.waiting.count <= SW_XCP_PLACES && access->unsent <= SW_XCP_SEED_LENGTH;
    for (uint32_t i = 0; i < SW_XCP_PLACES; i++) {
        sound &= i >= xcp.waiting.count || (xcp.waiting.lengths[i] > 0u && xcp.waiting.lengths[i] <= SW_XCP_MAX_CTO);
    }
    /* Without a connection there is no permission, and nothing to store. */
    return sound && access->key_bytes < SW_ANSWER_BYTES && (xcp.is_connected || (!access->is_unlocked && !xcp.has_to_store));
}

static void start(void)
{
    static const uint8_t key[SW_AES_BYTES];
    sw_xcp any;
    xcp = any;
    sw_xcp_init(&xcp, &calibrating, key, random_bytes, NULL);
    ASSUME(is_sound() && xcp.last_ns >= 0);
}

static void asked(uint8_t command)
{
    sw_frame frame;
    const int64_t now_ns = nondet_long();
    start();
    frame.data[0] = command;
    ASSUME(now_ns >= 0 && frame.length > 0u && frame.length <= SW_FRAME_BYTES);
    const int was_unlocked = xcp.access.is_unlocked, had_to_store = xcp.has_to_store;
    sw_xcp_command(&xcp, now_ns, &frame);
    PROVE(is_sound());
    if (xcp.access.is_unlocked && !was_unlocked) PROVE(is_right && frame.data[0] == SW_XCP_UNLOCK);
    if (xcp.has_to_store && !had_to_store) PROVE(was_unlocked);
}

void connected(void) { asked(SW_XCP_CONNECT); }
void disconnected(void) { asked(SW_XCP_DISCONNECT); }
void status_asked(void) { asked(SW_XCP_GET_STATUS); }
void seed_asked(void) { asked(SW_XCP_GET_SEED); }
void key_given(void) { asked(SW_XCP_UNLOCK); }
void store_asked(void) { asked(SW_XCP_SET_REQUEST); }
void written(void) { asked(SW_XCP_DOWNLOAD); }
void read_from(void) { asked(SW_XCP_SHORT_UPLOAD); }
void measured(void) { asked(SW_XCP_START_STOP_SYNCH); }
void event_asked(void) { asked(SW_XCP_GET_DAQ_EVENT_INFO); }
void unknown(void) { asked(0); }

void any_look(void)
{
    start();
    const int64_t now_ns = nondet_long();
    may_store = nondet_int();
    ASSUME(now_ns >= 0);
    sw_xcp_look(&xcp, now_ns, may_store);
    PROVE(is_sound());
}

#define ROOM 2

void any_poll(void)
{
    sw_frame frames[ROOM];
    const int room = nondet_int();
    start();
    ASSUME(room >= 0 && room <= ROOM);
    const int sent = sw_xcp_poll(&xcp, nondet_long(), room, &frames[ROOM - room]);
    PROVE(is_sound() && sent >= 0 && sent <= room);
    for (int i = 0; i < sent; i++) PROVE(frames[ROOM - room + i].length <= SW_XCP_MAX_CTO);
}
