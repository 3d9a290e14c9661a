/* The ECU's side of XCP on CAN (ASAM MCD-1 XCP 1.x): it processes and returns packets; the time is an argument. This
 * file corresponds to can_bridge/calibration/xcp.py and xcp_slave.py; it is compiled in if SW_XCP is 1.
 *
 * A tool reads and writes the same calibration as UDS (sw_calibrating), and reads or measures the latest control period
 * (sw_daq). The tool must wait for each answer. At most SW_XCP_PLACES packets can wait to be sent; a command is lost
 * if no place is free for its answer.
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
    uint8_t bytes[SW_XCP_PLACES][SW_XCP_MAX_CTO]; /* the waiting packets, oldest first */
} sw_xcp_packets;

typedef struct {
    const uint8_t *access_key;
    sw_random random;
    void *context;   /* argument of `random` */
    int64_t last_ns; /* time of the latest command */
    uint8_t is_connected;
    uint8_t has_to_store;
    sw_calibration to_store; /* values that were in force when the tool requested to store them */
    sw_xcp_access access;
    sw_xcp_memory memory;
    sw_xcp_packets waiting;
    sw_daq daq;
} sw_xcp;

/* Initialises the slave at power-on; its memory must be zero before. All arguments must stay valid during use. */
void sw_xcp_init(sw_xcp *xcp, sw_calibrating *calibrating, const uint8_t *access_key, sw_random random, void *context);

/* Returns whether a frame comes from the tool. */
int sw_xcp_is_command(const sw_frame *frame);

/* Processes a frame from the tool. */
void sw_xcp_command(sw_xcp *xcp, int64_t now_ns, const sw_frame *frame);

/* Checks for a timeout, and stores the requested values if `may_store`; called once in each call of diagnosis. */
void sw_xcp_look(sw_xcp *xcp, int64_t now_ns, int may_store);

/* Writes the frames to send now, at most `room` frames. Returns the number of frames. */
int sw_xcp_poll(sw_xcp *xcp, int64_t now_ns, int room, sw_frame *frames);

/* Returns whether packets wait to be sent. */
int sw_xcp_is_sending(const sw_xcp *xcp);

#endif

#endif
