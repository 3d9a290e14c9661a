/* What the task in ecu_task.c asks of the system. docs/how-to/board-and-rtos.md explains how to use these files. */

#ifndef ECU_PORT_H
#define ECU_PORT_H

#include "sw_ecu.h"

/* Frames that are kept between two steps; a period has one pressure frame, and one with the speed. */
#define ROOM 16

/* What the ECU listens to: pressures, the speed, and another ECU. On a busy bus all else would fill the room. */
#define HEARD {SW_PRESSURE_ID, SW_SPEED_ID, SW_COMMAND_ID, SW_STATUS_ID}

/* Never returns. */
void controller_task(void);

/* The time of a clock that is never set, the same in tasks and interrupts. */
int64_t clock_ns(void);

void sleep_until(int64_t due_ns);

/* Received since the last call, oldest first; returns how many. */
int take_frames(sw_frame *frames, int room);

/* Hands it over, and does not wait until it is on the bus. */
void send_frame(const sw_frame *frame);

/* The CAN controller's error counters. */
void note_health(sw_bus_health *health);

#if SW_SECOC
/* Reads the key and the freshness values from non-volatile memory, in which it has counted this power cycle; returns 0,
 * or 1 without them. */
int read_authentication(sw_authentication *given);

/* Writes the newest freshness values of the receivers there, as often as the memory bears it. */
void keep_freshness(const sw_ecu_state *state);
#endif

#endif
