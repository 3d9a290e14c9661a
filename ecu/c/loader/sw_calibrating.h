/* The calibration of the ECU through UDS and XCP. Both protocols read and write the same values. Control reads them
 * between two periods. Stored values survive a power loss. Values are sent as in memory: little-endian. This file
 * corresponds to can_bridge/calibration/segment.py and can_bridge/uds/calibration_service.py.
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
    uint8_t is_changed;     /* whether the new values must still be passed to the ECU */
    uint8_t is_kept;        /* whether a calibration is stored in non-volatile memory */
    sw_calibration working; /* the working page: values that UDS and XCP change */
    sw_calibration release; /* the reference page: the release's own values */
#if SW_XCP
    uint8_t page;     /* page whose values control uses: SW_PAGE_ */
    uint8_t begun_at; /* offset in bytes of the partly written value */
    uint8_t begun;    /* number of bytes of the partly written value that have been written */
    uint8_t begun_bytes[sizeof(float)];
#endif
} sw_calibrating;

/* Puts the stored values in force instead of the release's values, if the stored values are within their limits. */
void sw_calibrating_restore(sw_calibrating *calibrating);

/* Passes the values in force to the ECU if they have changed. Call it at the beginning of a control period. */
void sw_calibrating_hand_over(sw_calibrating *calibrating);

/* Read or write the value of an identifier. Both functions return 0 or the refusal's SW_NRC_ code. */
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

/* Copies `length` bytes of a page from the valid offset `at` on, including the bytes of a partly written value. */
void sw_calibrating_bytes(const sw_calibrating *calibrating, uint8_t page, uint32_t at, uint32_t length, uint8_t *bytes);

/* Writes up to SW_XCP_MAX_CTO - 2 bytes of the working page at the offset `at`, which must be the beginning of a value
 * or the end of the last write. The bytes of an incomplete value are kept until its other bytes are written; a write
 * that begins at a value discards them. Returns whether the write succeeded; if not, no value has changed.
 */
int sw_calibrating_write_bytes(sw_calibrating *calibrating, uint32_t at, const uint8_t *data, uint32_t length);

/* Stores values that are or were in force. Returns 0 or the refusal's SW_NRC_ code. */
uint8_t sw_calibrating_store(sw_calibrating *calibrating, const sw_calibration *values);
#endif

#endif
