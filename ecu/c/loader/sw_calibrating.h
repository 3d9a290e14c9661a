/* The calibration by diagnosis: what UDS reads and writes, and the control takes over between two periods; and the values
 * that outlive a loss of power. The twin of can_bridge/calibration/segment.py and service.py.
 *
 * Values go over the bus as they stand in memory: little-endian.
 */
#ifndef SW_CALIBRATING_H
#define SW_CALIBRATING_H

#include <stdint.h>

#include "sw_bytes.h"
#include "sw_ecu_state.h"
#include "sw_request.h"

typedef struct {
    sw_ecu *ecu;
    sw_store *store;
    const sw_vehicle_request *request;
    uint8_t is_changed;     /* whether the ECU has others yet */
    uint8_t is_kept;        /* whether values are stored */
    sw_calibration working; /* in force from the next control period on */
    sw_calibration release; /* the release's own */
} sw_calibrating;

/* Puts stored values in force, if they are in the limits: after a boot, once the ECU has the release's own values. */
void sw_calibrating_restore(sw_calibrating *calibrating);

/* Gives the ECU the values in force, if it has others: at the beginning of a control period. */
void sw_calibrating_hand_over(sw_calibrating *calibrating);

/* Writes the value of an identifier. Returns 0 or the SW_NRC_ of the refusal; so does sw_calibrating_write. */
uint8_t sw_calibrating_read(const sw_calibrating *calibrating, uint32_t number, sw_answer *answer);
uint8_t sw_calibrating_write(sw_calibrating *calibrating, uint32_t number, const uint8_t *value);

#endif
