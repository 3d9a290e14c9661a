/* The calibration by diagnosis: what UDS reads and writes, and the control takes over between two periods; and the values
 * that outlive a loss of power. The twin of can_bridge/calibration/segment.py and service.py.
 *
 * Values go over the bus as they stand in memory: little-endian.
 */
#ifndef SW_CALIBRATING_H
#define SW_CALIBRATING_H

#include <stdint.h>

#include "sw_answer.h"
#include "sw_ecu.h"
#include "sw_uds.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    sw_calibration working; /* in force from the next control period on */
    sw_calibration release; /* the release's own */
    uint8_t is_kept;        /* whether values are stored */
} sw_calibrating;

/* After a boot, once the ECU has the release's own values: stored ones come into force if they are in the limits. */
void sw_calibrating_restore(sw_node *node);

/* At the beginning of a control period: gives the ECU other values, if others are in force now. */
void sw_calibrating_hand_over(sw_node *node);

/* Writes the value of an identifier. Returns 0 or the SW_NRC_ of the refusal; so does sw_calibrating_write. */
uint8_t sw_calibrating_read(const sw_node *node, uint32_t number, sw_answer *answer);
uint8_t sw_calibrating_write(sw_node *node, uint32_t number, const uint8_t *value);

#ifdef __cplusplus
}
#endif

#endif
