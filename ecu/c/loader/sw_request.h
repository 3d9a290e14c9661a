/* Two reasons to refuse a tester's request, as UDS codes: the vehicle requests control, or the store refuses. This file
 * corresponds to ecu/flashable/watched_control.py.
 */
#ifndef SW_REQUEST_H
#define SW_REQUEST_H

#include <stdint.h>

#include "sw_store.h"
#include "sw_uds_settings.h"

/* Results of a handler besides a negative response code (SW_NRC_). */
#define SW_UDS_DONE 0u /* the answer is positive */
#define SW_UDS_MORE 1u /* the service needs further calls */

/* The vehicle's request for control, as received in the control periods; a recent request prevents flashing. */
typedef struct {
    uint8_t has_asked;
    uint8_t drives_jets;
    int64_t asked_ns; /* time of the latest period with usable pressures and a request for control */
    int64_t now_ns;   /* time of the latest call of diagnosis */
} sw_vehicle_request;

/* Returns the SW_NRC_ code with which flashing is refused now, or 0. */
static inline uint8_t sw_request_refusal(const sw_vehicle_request *request)
{
    const int asks = request->has_asked && request->now_ns - request->asked_ns < SW_REMEMBERED_NS;
    return (uint8_t)(request->drives_jets || asks ? SW_NRC_CONDITIONS_NOT_CORRECT : 0u);
}

/* Converts a result of the store to SW_UDS_DONE, SW_UDS_MORE or the refusal's SW_NRC_ code. */
static inline uint8_t sw_store_refusal(sw_store_result result)
{
    static const uint8_t codes[] = { /* codes in the order of sw_store_result */
        SW_UDS_DONE, SW_UDS_MORE, SW_NRC_OUT_OF_RANGE, SW_NRC_SEQUENCE_ERROR, SW_NRC_OUT_OF_RANGE,
        SW_NRC_PROGRAMMING_FAILURE,
    };
    return codes[result];
}

#endif
