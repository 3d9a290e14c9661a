/* The calibration by diagnosis: the values that UDS and XCP read and write, and that the control reads between two
 * periods; and the stored values, which survive a power loss. This file corresponds to
 * can_bridge/calibration/segment.py and uds/calibration_service.py.
 *
 * Values are sent in their memory layout: little-endian.
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
    uint8_t is_changed;     /* whether the ECU needs the new values */
    uint8_t is_kept;        /* whether values are stored */
    sw_calibration working; /* in force from the next control period on */
    sw_calibration release; /* the release's own values */
#if SW_XCP
    uint8_t page;     /* page in force: SW_PAGE_ */
    uint8_t begun_at; /* place of a partly written value, */
    uint8_t begun;    /* and the number of its written bytes */
    uint8_t begun_bytes[sizeof(float)];
#endif
} sw_calibrating;

/* Puts stored values in force if they are within their limits; called after a boot with the release's own values. */
void sw_calibrating_restore(sw_calibrating *calibrating);

/* Gives the ECU the values in force if they have changed, at the beginning of a control period. */
void sw_calibrating_hand_over(sw_calibrating *calibrating);

/* Read or write the value of an identifier. Both return 0 or the SW_NRC_ of the refusal. */
uint8_t sw_calibrating_read(const sw_calibrating *calibrating, uint32_t number, sw_answer *answer);
uint8_t sw_calibrating_write(sw_calibrating *calibrating, uint32_t number, const uint8_t *value);

#if SW_XCP
/* The two pages of the segment that a calibration tool sees; the working page is writable. */
#define SW_PAGE_WORKING 0u
#define SW_PAGE_REFERENCE 1u

/* Returns the values in force from the next period on. */
const sw_calibration *sw_calibrating_in_force(const sw_calibrating *calibrating);

void sw_calibrating_select(sw_calibrating *calibrating, uint8_t page);

/* Copies the release's own values to the working page. */
void sw_calibrating_copy_release(sw_calibrating *calibrating);

/* Copies bytes of a page, including those of a partly written value. `at` and `length` are within the values. */
void sw_calibrating_bytes(const sw_calibrating *calibrating, uint8_t page, uint32_t at, uint32_t length, uint8_t *bytes);

/* Writes up to SW_XCP_MAX_CTO - 2 bytes of the working page, in order: from the beginning of a value, or from the end
 * of the last write. The bytes of a partly written value wait for the rest; a write to another place discards them.
 * Returns whether the write succeeded; if not, the values are unchanged.
 */
int sw_calibrating_write_bytes(sw_calibrating *calibrating, uint32_t at, const uint8_t *data, uint32_t length);

/* Stores values that are or were in force. Returns 0 or the SW_NRC_ of the refusal. */
uint8_t sw_calibrating_store(sw_calibrating *calibrating, const sw_calibration *values);
#endif

#endif
