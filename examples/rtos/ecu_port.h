/* The functions that the task in ecu_task.c needs from the system (docs/how-to/board-and-rtos.md). */

#ifndef ECU_PORT_H
#define ECU_PORT_H

#include "sw_ecu.h"

/* Number of frames that can be stored between two steps. In each period two frames arrive: pressures and speed. */
#define ROOM 16

/* Identifiers of the frames that the ECU needs. On a busy bus, other frames would fill the buffer. */
#define HEARD {SW_PRESSURE_ID, SW_SPEED_ID, SW_COMMAND_ID, SW_STATUS_ID}

/* Runs the ECU; never returns. */
void controller_task(void);

/* Returns the time of a clock that is never set. Tasks and interrupts must use the same clock. */
int64_t clock_ns(void);

void sleep_until(int64_t due_ns);

/* Writes the frames received since the last call, oldest first, and returns their number. */
int take_frames(sw_frame *frames, int room);

/* Hands a frame to the CAN controller without waiting until the frame is sent. */
void send_frame(const sw_frame *frame);

/* Writes the CAN controller's error counters. */
void note_health(sw_bus_health *health);

#if SW_SECOC
/* Counts this power cycle in non-volatile memory, and reads the key and the freshness values. Returns 0, or 1 on
 * failure. */
int read_authentication(sw_authentication *given);

/* Stores the receivers' newest freshness values, as often as the non-volatile memory's wear permits. */
void keep_freshness(const sw_ecu_state *state);
#endif

#endif
