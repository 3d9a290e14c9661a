/* The calibration by diagnosis: what UDS and XCP read and write, and the control takes over between two periods; and the
 * values that outlive a loss of power. The twin of can_bridge/calibration/segment.py and uds/calibration_service.py.
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
#if SW_XCP
    uint8_t page;     /* in force: SW_PAGE_ */
    uint8_t begun_at; /* where a value lies that has not come whole, */
    uint8_t begun;    /* and how many of its bytes have */
    uint8_t begun_bytes[sizeof(float)];
#endif
} sw_calibrating;

/* Puts stored values in force, if they are in the limits: after a boot, once the ECU has the release's own values. */
void sw_calibrating_restore(sw_calibrating *calibrating);

/* Gives the ECU the values in force, if it has others: at the beginning of a control period. */
void sw_calibrating_hand_over(sw_calibrating *calibrating);

/* Writes the value of an identifier. Returns 0 or the SW_NRC_ of the refusal; so does sw_calibrating_write. */
uint8_t sw_calibrating_read(const sw_calibrating *calibrating, uint32_t number, sw_answer *answer);
uint8_t sw_calibrating_write(sw_calibrating *calibrating, uint32_t number, const uint8_t *value);

#if SW_XCP
/* The two contents of the segment that a calibration tool sees; the working one is writable. */
#define SW_PAGE_WORKING 0u
#define SW_PAGE_REFERENCE 1u

/* The values that control from the next period on. */
const sw_calibration *sw_calibrating_in_force(const sw_calibrating *calibrating);

void sw_calibrating_select(sw_calibrating *calibrating, uint8_t page);

/* The release's own values to the working page. */
void sw_calibrating_copy_release(sw_calibrating *calibrating);

/* Copies bytes of a page, with those of a value that has not come whole. `at` and `length` lie within the values. */
void sw_calibrating_bytes(const sw_calibrating *calibrating, uint8_t page, uint32_t at, uint32_t length, uint8_t *bytes);

/* Writes up to SW_XCP_MAX_CTO - 2 bytes of the working page, in order: from the beginning of a value, or from the end of the
 * last write. Bytes of a value that is not whole yet wait for the others, and are dropped by a write elsewhere. Returns
 * whether it was done; else the values are as before.
 */
int sw_calibrating_write_bytes(sw_calibrating *calibrating, uint32_t at, const uint8_t *data, uint32_t length);

/* Stores values that are or were in force. Returns 0 or the SW_NRC_ of the refusal. */
uint8_t sw_calibrating_store(sw_calibrating *calibrating, const sw_calibration *values);
#endif

#endif
