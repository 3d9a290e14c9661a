/* One end of an ISO-TP connection (ISO 15765-2:2016), as a state machine of time and frames: the twin of
 * can_bridge/isotp/endpoint.py. Messages of 1 to SW_ISOTP_MOST bytes, one at a time in each direction.
 *
 * Times are in ns, from 0 to 2^61.
 */
#ifndef SW_ISOTP_H
#define SW_ISOTP_H

#include <stdint.h>

#include "sw_ecu_state.h"
#include "sw_uds_settings.h"

#define SW_ISOTP_MOST 4095u /* bytes that the 12-bit length of a first frame can name */

/* Messages that wait to be sent, with the one under way. */
typedef struct {
    uint8_t count; /* of those that wait */
    uint16_t under_way; /* bytes of the message under way; 0 without one */
    uint16_t lengths[SW_ISOTP_QUEUE];
    uint8_t bytes[SW_ISOTP_ROOM]; /* the one under way, then those that wait, oldest first */
} sw_isotp_queue;

typedef struct {
    uint8_t *message; /* SW_ISOTP_MOST bytes, the caller's: what has come of a message of several frames */
    uint8_t *whole;   /* where the message is that has come last */
    uint8_t is_held;  /* `message` is still read: another one for it is refused as too much */
    /* Reception. */
    uint8_t frame_length; /* of its first frame */
    uint8_t next_number;
    uint8_t answer;  /* flow status that is due, or SW_ISOTP_NO_ANSWER */
    uint16_t wanted; /* bytes of the message on its way; 0 without one */
    uint16_t received;
    int64_t next_until_ns;
    /* Transmission. */
    uint8_t state;
    uint8_t number;
    uint8_t block_size;
    uint8_t left_in_block;
    uint8_t waits;
    uint16_t sent;
    int64_t separation_ns;
    int64_t not_before_ns;
    int64_t flow_until_ns;
    sw_isotp_queue queue;
    /* Messages that did not arrive, since the start. */
    uint32_t aborted_receptions;
    uint32_t aborted_transmissions;
    uint32_t dropped_sent;
} sw_isotp;

/* Starts an end, after power-on; `message` has SW_ISOTP_MOST bytes. */
void sw_isotp_init(sw_isotp *end, uint8_t *message);

/* Whether a frame is the tester's, to this ECU alone or to every one. */
int sw_isotp_is_request(const sw_frame *frame);

/* A request to every ECU, which has one frame alone: others would ask for flow control. It is another conversation than
 * the one with this ECU, of which it interrupts nothing. Returns its bytes, which stand in `message`, or 0.
 */
uint32_t sw_isotp_functional(const sw_frame *frame, uint8_t message[SW_FRAME_BYTES]);

/* Takes a frame from the bus; frames for others are ignored. Returns the bytes of a message that is whole now, or 0. It
 * stands at `whole`: one of a single frame in `single`, others in `message`, until the next call or as long as `is_held`.
 */
uint32_t sw_isotp_receive(sw_isotp *end, int64_t now_ns, const sw_frame *frame, uint8_t single[SW_FRAME_BYTES]);

/* Whether a message is on its way to us, or one of ours is not on the bus as a whole. */
int sw_isotp_is_receiving(const sw_isotp *end);
int sw_isotp_is_sending(const sw_isotp *end);

/* Whether messages that are not on the bus as a whole have more bytes than may stand beside the longest one. */
int sw_isotp_is_occupied(const sw_isotp *end);

/* Whether so many messages wait that only SW_ISOTP_KEPT more find a place: those of a request that is worked on. */
int sw_isotp_is_full(const sw_isotp *end);

/* Where the next message to be sent may be written, and how many bytes there are. */
uint8_t *sw_isotp_place(sw_isotp *end, uint32_t *room);

/* Has the `length` bytes that the message has sent by the calls of sw_isotp_poll that follow. One that is longer than
 * its room was, or that finds SW_ISOTP_QUEUE messages waiting, is dropped and counted.
 */
void sw_isotp_send(sw_isotp *end, uint32_t length);

/* Frames to be put on the bus now, SW_ISOTP_BURST at most and no more than there is room for: the answer to the other end
 * first, then what we send. What has no room comes with a later call. Returns how many.
 */
int sw_isotp_poll(sw_isotp *end, int64_t now_ns, int room, sw_frame frames[SW_ISOTP_BURST]);

#endif
