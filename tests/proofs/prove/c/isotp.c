/* ISO-TP: any frame, in any state that an end can be in, and what it sends. The bytes of messages decide nothing. */
#include "bytes_model.h"

#include "sw_isotp.c"

#define LATEST ((int64_t)1 << 61)

static uint8_t message[SW_ISOTP_MOST];

static int is_sound(const sw_isotp *end)
{
    const sw_isotp_queue *queue = &end->queue;
    uint32_t bytes = queue->under_way;
    int sound = queue->count <= SW_ISOTP_QUEUE;
    for (uint32_t i = 0; i < SW_ISOTP_QUEUE; i++) {
        if (i < queue->count) {
            bytes += queue->lengths[i];
            sound &= queue->lengths[i] > 0u;
        }
    }
    sound &= bytes <= SW_ISOTP_ROOM;
    sound &= end->wanted == 0u || (end->received < end->wanted && end->wanted <= SW_ISOTP_MOST &&
                                   end->frame_length >= CLASSIC && end->frame_length <= SW_FRAME_BYTES);
    sound &= end->next_number < NUMBERS && end->number < NUMBERS && end->answer <= NO_ANSWER && end->state <= SENDING;
    sound &= (end->state == IDLE) == (queue->under_way == 0u);
    sound &= end->state == WAITING || end->state == SENDING ? end->sent < queue->under_way : 1;
    sound &= end->separation_ns >= 0 && end->separation_ns <= (int64_t)LONGEST_MS * MS;
    return sound;
}

static void start(sw_isotp *end, int64_t now_ns)
{
    end->message = message;
    end->whole = message;
    ASSUME(is_sound(end) && now_ns >= 0 && now_ns <= LATEST);
}

/* Frames of one of the four kinds by themselves, as sw_isotp_receive hands them over once the time was looked at. */
static void any_frame(sw_isotp *end, sw_frame *frame, int64_t now_ns)
{
    start(end, now_ns);
    ASSUME(frame->length > 0u && frame->length <= SW_FRAME_BYTES);
}

static void whole(const sw_isotp *end, uint32_t length)
{
    PROVE(is_sound(end) && length <= SW_ISOTP_MOST);
    if (length > 0u) PROVE(end->wanted == 0u);
}

void any_time(void)
{
    sw_isotp end;
    const int64_t now_ns = nondet_long();
    start(&end, now_ns);
    tick(&end, now_ns);
    PROVE(is_sound(&end));
}

void any_single(void)
{
    sw_isotp end;
    sw_frame frame;
    uint8_t single[SW_FRAME_BYTES];
    any_frame(&end, &frame, 0);
    whole(&end, in_one(&end, &frame, single));
}

void any_first(void)
{
    sw_isotp end;
    sw_frame frame;
    const int64_t now_ns = nondet_long();
    any_frame(&end, &frame, now_ns);
    first(&end, now_ns, &frame);
    whole(&end, 0);
}

void any_consecutive(void)
{
    sw_isotp end;
    sw_frame frame;
    const int64_t now_ns = nondet_long();
    any_frame(&end, &frame, now_ns);
    whole(&end, consecutive(&end, now_ns, &frame));
}

void any_flow(void)
{
    sw_isotp end;
    sw_frame frame;
    const int64_t now_ns = nondet_long();
    any_frame(&end, &frame, now_ns);
    flow(&end, now_ns, &frame);
    whole(&end, 0);
}

void any_functional(void)
{
    sw_frame frame;
    uint8_t single[SW_FRAME_BYTES];
    PROVE(sw_isotp_functional(&frame, single) <= SW_FRAME_BYTES - 2u);
}

/* One frame of what is sent; sw_isotp_poll asks for SW_ISOTP_BURST at most, one after the other. */
void next_sent(void)
{
    sw_isotp end;
    sw_frame frame;
    const int64_t now_ns = nondet_long();
    start(&end, now_ns);
    if (next_frame(&end, now_ns, &frame)) {
        PROVE(frame.length >= CLASSIC && frame.length <= SW_FRAME_BYTES && frame.id == SW_RESPONSE_ID);
    }
    PROVE(is_sound(&end));
}

/* A message that is queued: there is room for it, or it is dropped. */
void any_queued(void)
{
    sw_isotp end;
    uint32_t room = nondet_uint();
    const uint32_t length = nondet_uint();
    start(&end, 0);
    uint8_t *place = sw_isotp_place(&end, &room);
    PROVE(place >= end.queue.bytes && place + room == end.queue.bytes + SW_ISOTP_ROOM);
    ASSUME(length > 0u);
    sw_isotp_send(&end, length);
    PROVE(is_sound(&end));
}
