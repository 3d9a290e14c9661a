/* The ECU's side of XCP on CAN (ASAM MCD-1 XCP 1.x): packets in, packets out, time as an argument. The twin of
 * can_bridge/calibration/xcp.py and xcp_slave.py. Compiled in where SW_XCP is 1.
 *
 * A tool reads and writes the calibration that UDS reads and writes (sw_calibrating), and reads or measures the latest
 * control period (sw_daq). It waits for each answer: SW_XCP_PLACES packets wait to be sent, and what finds no place is lost.
 */
#ifndef SW_XCP_H
#define SW_XCP_H

#include <stdint.h>

#include "sw_daq.h"
#include "sw_xcp_access.h"
#include "sw_xcp_memory.h"

#if SW_XCP

typedef struct {
    uint8_t count;
    uint8_t lengths[SW_XCP_PLACES];
    uint8_t bytes[SW_XCP_PLACES][SW_XCP_MAX_CTO]; /* oldest first */
} sw_xcp_packets;

typedef struct {
    const uint8_t *access_key;
    sw_random random;
    void *context;   /* for `random` */
    int64_t last_ns; /* of the latest command */
    uint8_t is_connected;
    uint8_t has_to_store;
    sw_calibration to_store; /* in force when the tool asked to store */
    sw_xcp_access access;
    sw_xcp_memory memory;
    sw_xcp_packets waiting;
    sw_daq daq;
} sw_xcp;

/* At power-on, in memory of zeros; what is given outlives it. */
void sw_xcp_init(sw_xcp *xcp, sw_calibrating *calibrating, const uint8_t *access_key, sw_random random, void *context);

/* Whether a frame is the tool's. */
int sw_xcp_is_command(const sw_frame *frame);

/* Takes such a frame. */
void sw_xcp_command(sw_xcp *xcp, int64_t now_ns, const sw_frame *frame);

/* Looks at the time, and stores what was asked for if it may be now; once in each look at diagnosis. */
void sw_xcp_look(sw_xcp *xcp, int64_t now_ns, int may_store);

/* Frames to be put on the bus now, no more than there is room for. Returns how many. */
int sw_xcp_poll(sw_xcp *xcp, int64_t now_ns, int room, sw_frame *frames);

/* Whether packets wait. */
int sw_xcp_is_sending(const sw_xcp *xcp);

#endif

#endif
