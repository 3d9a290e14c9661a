/* An endpoint of an ISO-TP connection (ISO 15765-2:2016): a state machine that reads no clock. This file corresponds to
 * can_bridge/isotp/endpoint.py. Messages have 1 to SW_ISOTP_MOST bytes; each direction transfers one message at a time.
 *
 * Times are in ns, from 0 to 2^61.
 */
#ifndef SW_ISOTP_H
#define SW_ISOTP_H

#include <stdint.h>

#include "sw_ecu_state.h"
#include "sw_uds_settings.h"

#define SW_ISOTP_MOST 4095u /* largest length that the 12 bits in a first frame can state */

/* The message being sent, and the messages that wait. */
typedef struct {
    uint8_t count;      /* number of waiting messages */
    uint16_t under_way; /* length of the message being sent, in bytes; 0 if none is being sent */
    uint16_t lengths[SW_ISOTP_QUEUE];
    uint8_t bytes[SW_ISOTP_ROOM]; /* the message being sent, then the waiting messages, oldest first */
} sw_isotp_queue;

typedef struct {
    uint8_t *message; /* the caller's SW_ISOTP_MOST bytes, for a message of several frames */
    uint8_t *whole;   /* address of the latest complete message */
    uint8_t is_held;  /* whether `message` is still being read; a new message of several frames is then refused */
    /* Reception. */
    uint8_t frame_length; /* length of the message's first frame */
    uint8_t next_number;
    uint8_t answer;  /* flow status to send next, or NO_ANSWER (sw_isotp.c) */
    uint16_t wanted; /* length of the message being received, in bytes; 0 if none is being received */
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
    /* Numbers of lost messages since the start. */
    uint32_t aborted_receptions;
    uint32_t aborted_transmissions;
    uint32_t dropped_sent;
} sw_isotp;

/* Initialises an endpoint after power-on; `message` has SW_ISOTP_MOST bytes. */
void sw_isotp_init(sw_isotp *end, uint8_t *message);

/* Returns whether a frame comes from the tester, addressed to this ECU alone or to every ECU. */
int sw_isotp_is_request(const sw_frame *frame);

/* Reads a request to every ECU. Such a request has only one frame, since several frames would need flow control. The
 * request does not interrupt a transfer between the tester and this ECU. Copies the request to `message`, and returns
 * its length; returns 0 if the frame is no such request.
 */
uint32_t sw_isotp_functional(const sw_frame *frame, uint8_t message[SW_FRAME_BYTES]);

/* Processes a frame from the bus; frames for other nodes are ignored. Returns the length of the message that this frame
 * completes, or 0. `whole` then points to the message: to `single` after a single frame, otherwise to `message`. The
 * pointer is valid until the next call, or as long as `is_held` is 1.
 */
uint32_t sw_isotp_receive(sw_isotp *end, int64_t now_ns, const sw_frame *frame, uint8_t single[SW_FRAME_BYTES]);

/* Return whether a message is being received, and whether a message is not completely sent yet. */
int sw_isotp_is_receiving(const sw_isotp *end);
int sw_isotp_is_sending(const sw_isotp *end);

/* Returns whether the free room in the queue is too small for the longest message. */
int sw_isotp_is_occupied(const sw_isotp *end);

/* Returns whether the queue has no free place except the SW_ISOTP_KEPT places for answers to the present request. */
int sw_isotp_is_full(const sw_isotp *end);

/* Returns the buffer for the next message to send, and stores the number of its free bytes in `room`. */
uint8_t *sw_isotp_place(sw_isotp *end, uint32_t *room);

/* Queues a message of `length` bytes that the caller has written into the buffer of sw_isotp_place; later calls of
 * sw_isotp_poll send the message. A message is dropped and counted if it does not fit into the buffer, or if
 * SW_ISOTP_QUEUE messages are waiting.
 */
void sw_isotp_send(sw_isotp *end, uint32_t length);

/* Writes the frames to send now: first the flow control for the other end, then this end's messages. It writes at most
 * SW_ISOTP_BURST and at most `room` frames; a later call writes the rest. Returns the number of frames.
 */
int sw_isotp_poll(sw_isotp *end, int64_t now_ns, int room, sw_frame frames[SW_ISOTP_BURST]);

#endif
