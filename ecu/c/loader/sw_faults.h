/* The fault memory: status, age and one snapshot of each trouble code. Its content survives resets. This file
 * corresponds to can_bridge/uds/fault_memory.py and to ecu/flashable/watched_control.py.
 *
 * The content is written to the store only while no jet can run, and only if it has changed.
 */
#ifndef SW_FAULTS_H
#define SW_FAULTS_H

#include <stdint.h>

#include "sw_bytes.h"
#include "sw_ecu_state.h"
#include "sw_request.h"

typedef struct {
    uint8_t status;
    uint8_t age;          /* age of a confirmed fault: number of operation cycles without this fault */
    uint8_t has_snapshot; /* whether a snapshot exists (of the first failure in the latest cycle with a failure) */
    uint8_t snapshot[SW_SNAPSHOT_BYTES];
} sw_fault;

typedef struct {
    const sw_ecu *ecu;
    sw_store *store;
    const sw_vehicle_request *request;
    sw_fault faults[SW_FAULT_COUNT]; /* in the order of SW_FAULT_CODES */
    uint8_t is_off;                  /* whether a tester has switched off the recording of faults */
    uint8_t is_changed;              /* whether a fault has changed since the last attempt to store */
    uint8_t has_latest;              /* whether a test result waits until `is_off` is 0 */
    uint8_t latest;                  /* the waiting result: reason of a failed test; SW_REASON_NONE: all tests passed */
    uint8_t latest_snapshot[SW_SNAPSHOT_BYTES];
    /* Data for snapshots: the time of the first control period, and the ECU's state before the present period. */
    uint8_t has_power_on;
    uint8_t was; /* sw_operating_mode before the period */
    int64_t power_on_ns;
    float pressures_cp[SW_SENSORS]; /* newest pressures before the period */
} sw_faults;

/* Reads the stored faults and begins their next operation cycle. Call it at power-on, when the store is open. */
void sw_faults_open(sw_faults *faults);

/* Examine the ECU before and after each control period. */
void sw_faults_before(sw_faults *faults);
void sw_faults_after(sw_faults *faults, int64_t now_ns);

/* Records a waiting result, and stores changes if storing is allowed now. A failed write is not repeated. */
void sw_faults_settle(sw_faults *faults);

/* Services 0x14, 0x19 and 0x85. Each returns SW_UDS_DONE or the refusal's SW_NRC_ code. */
uint8_t sw_faults_clear(sw_faults *faults, const uint8_t *body, uint32_t length);
uint8_t sw_faults_report(const sw_faults *faults, const uint8_t *body, uint32_t length, sw_answer *answer);
uint8_t sw_faults_set(sw_faults *faults, const uint8_t *body, uint32_t length, sw_answer *answer);

#endif
