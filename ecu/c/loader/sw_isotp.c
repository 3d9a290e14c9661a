/* The ISO-TP endpoint. It assembles messages from frames, and divides messages into frames. */
#include "sw_isotp.h"

#include <stddef.h>

#include "sw_bytes.h"
#include "sw_counts.h"

enum { SINGLE, FIRST, CONSECUTIVE, FLOW }; /* type of a frame, in the upper half of its first byte */
enum { FLOW_CONTINUE, FLOW_WAIT, FLOW_OVERFLOW, NO_ANSWER };
enum { IDLE, READY, WAITING, SENDING };

#define CLASSIC 8u
#define PADDING 0xccu /* this value causes the fewest stuff bits */
#define NUMBERS 16u   /* sequence numbers have four bits */
#define MS INT64_C(1000000)
#define LONGEST_MS 0x7fu
#define SHORTEST_CODE 0xf1u /* first of the separation-time codes for 100 us to 900 us */
#define LONGEST_CODE 0xf9u
#if SW_FRAMES_FD
#define FRAME_LENGTH 64u
#else
#define FRAME_LENGTH CLASSIC
#endif

/* Returns the length of the longest message that fits into a single frame of this length. */
static uint32_t capacity(uint32_t frame_length) { return frame_length - (frame_length <= CLASSIC ? 1u : 2u); }

/* --- Reception --- */

static void abort_reception(sw_isotp *end)
{
    if (end->wanted > 0u) end->aborted_receptions = sw_counted(end->aborted_receptions, 1);
    end->wanted = 0;
}

/* Copies the message of a single frame. Returns the message's length, or 0 for an invalid frame. */
static uint32_t single_of(const sw_frame *frame, uint8_t *message)
{
    const uint32_t low = frame->data[0] & 0xfu;
    const uint32_t header = frame->length <= CLASSIC ? 1u : 2u;
    const uint32_t length = header == 1u ? low : frame->data[1];
    if ((header == 2u && low != 0u) || length == 0u || length > frame->length - header) return 0;
    sw_bytes_copy(message, &frame->data[header], length);
    return length;
}

static uint32_t in_one(sw_isotp *end, const sw_frame *frame, uint8_t *message)
{
    const uint32_t length = single_of(frame, message);
    if (length > 0u) {
        abort_reception(end);
        end->whole = message;
    }
    return length;
}

/* Begins to receive a message; discards an earlier incomplete message. Lengths of more than 12 bits are refused. */
static void first(sw_isotp *end, int64_t now_ns, const sw_frame *frame)
{
    if (frame->length < CLASSIC) return;
    const uint8_t *data = frame->data;
    const uint32_t length = (data[0] & 0xfu) << 8 | data[1];
    if (length == 0u) {
        if (sw_big_u32(&data[2]) > SW_ISOTP_MOST) {
            abort_reception(end);
            end->answer = FLOW_OVERFLOW;
        }
        return;
    }
    if (length <= capacity(frame->length)) return;
    if (end->is_held) {
        end->answer = FLOW_OVERFLOW;
        return;
    }
    abort_reception(end);
    end->wanted = (uint16_t)length;
    end->received = (uint16_t)(frame->length - 2u);
    end->frame_length = frame->length;
    end->next_number = 1;
    end->next_until_ns = now_ns + SW_ISOTP_WAIT_NS;
    end->answer = FLOW_CONTINUE;
    sw_bytes_copy(end->message, &data[2], end->received);
}

/* Processes a consecutive frame. Only the last frame may be shorter than the first frame. Any other shorter frame is
 * ignored. The next frame then has a wrong sequence number, which aborts the reception.
 */
static uint32_t consecutive(sw_isotp *end, int64_t now_ns, const sw_frame *frame)
{
    if (end->wanted == 0u) return 0;
    if ((frame->data[0] & 0xfu) != end->next_number) {
        abort_reception(end);
        return 0;
    }
    const uint32_t count = frame->length - 1u;
    const uint32_t longest = end->frame_length - 1u;
    const uint32_t missing = (uint32_t)end->wanted - end->received;
    const uint32_t taken = missing < count ? missing : count;
    if (count > longest || (count < longest && count < missing)) return 0;
    sw_bytes_copy(&end->message[end->received], &frame->data[1], taken);
    end->received = (uint16_t)(end->received + taken);
    end->next_number = (uint8_t)((end->next_number + 1u) % NUMBERS);
    end->next_until_ns = now_ns + SW_ISOTP_WAIT_NS;
    if (end->received < end->wanted) return 0;
    end->wanted = 0;
    end->whole = end->message;
    return end->received;
}

/* --- Transmission --- */

/* Returns the total length in bytes of the message being sent and the waiting messages. */
static uint32_t used(const sw_isotp_queue *queue)
{
    uint32_t bytes = queue->under_way;
    for (uint32_t i = 0; i < queue->count; i++) bytes += queue->lengths[i];
    return bytes;
}

static void end_transmission(sw_isotp *end)
{
    sw_isotp_queue *queue = &end->queue;
    sw_bytes_copy(queue->bytes, &queue->bytes[queue->under_way], used(queue) - queue->under_way);
    queue->under_way = 0;
    end->state = IDLE;
}

static void abort_transmission(sw_isotp *end)
{
    end->aborted_transmissions = sw_counted(end->aborted_transmissions, 1);
    end_transmission(end);
}

static void wait_for_flow(sw_isotp *end, int64_t now_ns)
{
    end->state = WAITING;
    end->flow_until_ns = now_ns + SW_ISOTP_WAIT_NS;
}

/* Returns the least time in ns between two frames for a separation-time code. Reserved codes mean the longest time. */
static int64_t separation_ns(uint32_t code)
{
    if (code >= SHORTEST_CODE && code <= LONGEST_CODE) return (int64_t)(code - SHORTEST_CODE + 1u) * (MS / 10);
    return (code < LONGEST_MS ? code : LONGEST_MS) * MS;
}

/* Processes the receiver's flow control; ignores it if no flow control is expected. */
static void flow(sw_isotp *end, int64_t now_ns, const sw_frame *frame)
{
    if (frame->length < 3u || end->state != WAITING) return;
    const uint32_t status = frame->data[0] & 0xfu;
    if (status == FLOW_CONTINUE) {
        end->state = SENDING;
        end->block_size = frame->data[1];
        end->left_in_block = end->block_size;
        end->separation_ns = separation_ns(frame->data[2]);
        end->not_before_ns = now_ns;
        end->waits = 0;
    } else if (status == FLOW_WAIT && end->waits < SW_ISOTP_WAITS) {
        end->waits++;
        end->flow_until_ns = now_ns + SW_ISOTP_WAIT_NS;
    } else {
        abort_transmission(end);
    }
}

static void start_frame(sw_frame *frame, int64_t now_ns)
{
    frame->timestamp_ns = now_ns;
    frame->id = SW_RESPONSE_ID;
    frame->is_extended = SW_DIAGNOSIS_EXTENDED;
    frame->is_fd = SW_FRAMES_FD;
    frame->length = 0;
}

static void put(sw_frame *frame, uint32_t byte)
{
    frame->data[frame->length] = (uint8_t)byte;
    frame->length++;
}

static void put_all(sw_frame *frame, const uint8_t *data, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) put(frame, data[i]);
}

/* Pads a frame to the next valid length, which is at least 8 bytes. */
static void pad(sw_frame *frame)
{
    static const uint8_t lengths[] = {8, 12, 16, 20, 24, 32, 48, 64};
    uint32_t i = 0;
    while (lengths[i] < frame->length) i++;
    while (frame->length < lengths[i]) put(frame, PADDING);
}

/* Writes the single frame or the first frame of the message being sent. */
static void begin(sw_isotp *end, int64_t now_ns, sw_frame *frame)
{
    const uint32_t length = end->queue.under_way;
    if (length <= capacity(FRAME_LENGTH)) {
        if (length >= CLASSIC) put(frame, 0);
        put(frame, length);
        put_all(frame, end->queue.bytes, length);
        end_transmission(end);
        return;
    }
    put(frame, (uint32_t)FIRST << 4 | length >> 8);
    put(frame, length & 0xffu);
    put_all(frame, end->queue.bytes, FRAME_LENGTH - 2u);
    end->sent = FRAME_LENGTH - 2u;
    end->number = 1;
    end->waits = 0;
    wait_for_flow(end, now_ns);
}

/* Writes the next consecutive frame of the message being sent. */
static void go_on(sw_isotp *end, int64_t now_ns, sw_frame *frame)
{
    const uint32_t left = (uint32_t)end->queue.under_way - end->sent;
    const uint32_t count = left < FRAME_LENGTH - 1u ? left : FRAME_LENGTH - 1u;
    put(frame, (uint32_t)CONSECUTIVE << 4 | end->number);
    put_all(frame, &end->queue.bytes[end->sent], count);
    end->sent = (uint16_t)(end->sent + count);
    end->number = (uint8_t)((end->number + 1u) % NUMBERS);
    end->not_before_ns = now_ns + end->separation_ns;
    if (count == left) {
        end_transmission(end);
    } else if (end->left_in_block > 0u) {
        end->left_in_block--;
        if (end->left_in_block == 0u) wait_for_flow(end, now_ns);
    } else {
        /* With a block size of 0, all remaining frames may be sent. */
    }
}

/* Begins to send the oldest waiting message, if there is one. */
static void take_next(sw_isotp *end)
{
    sw_isotp_queue *queue = &end->queue;
    if (end->state != IDLE || queue->count == 0u) return;
    queue->under_way = queue->lengths[0];
    queue->count--;
    for (uint32_t i = 0; i < queue->count; i++) queue->lengths[i] = queue->lengths[i + 1u];
    end->state = READY;
}

/* Writes the next frame, if a frame of the message being sent is due now. Returns whether a frame was written. */
static int next_frame(sw_isotp *end, int64_t now_ns, sw_frame *frame)
{
    take_next(end);
    const int may = end->state == READY || (end->state == SENDING && now_ns >= end->not_before_ns);
    if (may) {
        start_frame(frame, now_ns);
        if (end->state == READY) {
            begin(end, now_ns, frame);
        } else {
            go_on(end, now_ns, frame);
        }
        pad(frame);
    }
    return may;
}

/* --- The whole endpoint --- */

static void tick(sw_isotp *end, int64_t now_ns)
{
    if (end->wanted > 0u && now_ns > end->next_until_ns) abort_reception(end);
    if (end->state == WAITING && now_ns > end->flow_until_ns) abort_transmission(end);
}

void sw_isotp_init(sw_isotp *end, uint8_t *message)
{
    sw_bytes_fill((uint8_t *)end, 0, sizeof *end);
    end->message = message;
    end->whole = message;
    end->answer = NO_ANSWER;
    end->state = IDLE;
}

static int is_for(const sw_frame *frame, uint32_t id)
{
    return frame->id == id && (frame->is_extended != 0u) == (SW_DIAGNOSIS_EXTENDED != 0);
}

static int is_functional(const sw_frame *frame) { return SW_FUNCTIONAL != 0 && is_for(frame, SW_FUNCTIONAL_ID); }

int sw_isotp_is_request(const sw_frame *frame) { return is_for(frame, SW_REQUEST_ID) || is_functional(frame); }

uint32_t sw_isotp_functional(const sw_frame *frame, uint8_t message[SW_FRAME_BYTES])
{
    if (!is_functional(frame) || frame->length == 0u || frame->length > SW_FRAME_BYTES) return 0;
    return frame->data[0] >> 4 == SINGLE ? single_of(frame, message) : 0u;
}

uint32_t sw_isotp_receive(sw_isotp *end, int64_t now_ns, const sw_frame *frame, uint8_t single[SW_FRAME_BYTES])
{
    uint32_t length = 0;
    if (!is_for(frame, SW_REQUEST_ID)) return 0;
    tick(end, now_ns);
    if (frame->length == 0u || frame->length > SW_FRAME_BYTES) return 0;
    switch (frame->data[0] >> 4) {
    case SINGLE:
        length = in_one(end, frame, single);
        break;
    case FIRST:
        first(end, now_ns, frame);
        break;
    case CONSECUTIVE:
        length = consecutive(end, now_ns, frame);
        break;
    case FLOW:
        flow(end, now_ns, frame);
        break;
    default:
        break; /* frame types from 4 on are reserved for later versions of the standard */
    }
    return length;
}

int sw_isotp_is_receiving(const sw_isotp *end) { return end->wanted > 0u; }

int sw_isotp_is_sending(const sw_isotp *end) { return end->state != IDLE || end->queue.count > 0u; }

int sw_isotp_is_full(const sw_isotp *end) { return end->queue.count + SW_ISOTP_KEPT >= SW_ISOTP_QUEUE; }

int sw_isotp_is_occupied(const sw_isotp *end) { return used(&end->queue) > SW_ISOTP_BESIDE; }

uint8_t *sw_isotp_place(sw_isotp *end, uint32_t *room)
{
    sw_isotp_queue *queue = &end->queue;
    const uint32_t place = used(queue);
    *room = SW_ISOTP_ROOM - place;
    return &queue->bytes[place];
}

void sw_isotp_send(sw_isotp *end, uint32_t length)
{
    uint32_t room;
    (void)sw_isotp_place(end, &room);
    if (end->queue.count == SW_ISOTP_QUEUE || length > room) {
        end->dropped_sent = sw_counted(end->dropped_sent, 1);
        return;
    }
    end->queue.lengths[end->queue.count] = (uint16_t)length;
    end->queue.count++;
}

int sw_isotp_poll(sw_isotp *end, int64_t now_ns, int room, sw_frame frames[SW_ISOTP_BURST])
{
    const int most = room < SW_ISOTP_BURST ? room : SW_ISOTP_BURST;
    int count = 0;
    tick(end, now_ns);
    if (end->answer == FLOW_CONTINUE && end->wanted == 0u) end->answer = NO_ANSWER;
    if (end->answer != NO_ANSWER && most > 0) {
        start_frame(&frames[0], now_ns);
        put(&frames[0], (uint32_t)FLOW << 4 | end->answer);
        put(&frames[0], 0); /* block size 0: the sender needs no further flow control */
        put(&frames[0], 0); /* separation time 0: the sender need not pause between frames */
        pad(&frames[0]);
        end->answer = NO_ANSWER;
        count = 1;
    }
    while (count < most && next_frame(end, now_ns, &frames[count])) count++;
    return count;
}
