/* The measurement by XCP (DAQ), with one dynamic list. Its only event is the end of a control period. This file
 * corresponds to can_bridge/calibration/daq.py.
 *
 * If a control period ends before all frames of an earlier period are sent, the new period is not measured. Frames of
 * two periods are therefore never mixed.
 */
#ifndef SW_DAQ_H
#define SW_DAQ_H

#include <stdint.h>

#include "sw_bytes.h"
#include "sw_ecu_state.h"
#include "sw_uds_settings.h"

#if SW_XCP

/* The values of a control period that a tool can read or measure, in their memory layout: little-endian. */
typedef struct {
    float pressures[SW_SENSORS]; /* Cp in the newest row of the controller's window */
    float command;               /* sent action, in U_inf W */
    uint8_t mode;                /* SW_MODE_ */
    uint8_t reason;              /* SW_REASON_ */
    uint8_t gated;               /* SW_GATED_ bits */
    int8_t correction;           /* (speed in use / speed on the bus - 1) * 1000 */
    sw_calibration calibration; /* values in force in this period */
} sw_measured;

typedef struct {
    uint8_t at;    /* offset of the value in sw_measured */
    uint8_t bytes; /* length of the value in bytes; 0 if the entry is not written yet */
} sw_daq_entry;

typedef struct {
    sw_measured measured;
    uint8_t stage; /* stage of the allocation */
    uint8_t lists;
    uint8_t odts;
    uint8_t used; /* number of allocated entries */
    uint8_t has_pointer;
    uint8_t odt; /* ODT whose entry is written next */
    uint8_t entry;
    uint8_t is_selected;
    uint8_t is_running;
    uint8_t next;               /* ODT that is sent next; `odts` if none is due */
    uint8_t first[SW_XCP_ODTS]; /* first entry of each ODT */
    uint8_t count[SW_XCP_ODTS];
    sw_daq_entry entries[SW_XCP_ENTRIES];
} sw_daq;

/* Stops and deletes the list. */
void sw_daq_free(sw_daq *daq);

/* Copies the values of a control period that has ended, unless packets of an earlier period still wait. */
void sw_daq_sample(sw_daq *daq, const sw_ecu *ecu, uint8_t mode);

/* Writes the next packet with measured values (at most SW_XCP_MAX_CTO bytes); returns its length, 0 if none is due. */
uint32_t sw_daq_packet(sw_daq *daq, uint8_t *packet);

/* Answers a measurement command; the caller checks its length. Returns SW_XCP_DONE or an SW_XCP_ERROR_ code. */
uint8_t sw_daq_command(sw_daq *daq, const uint8_t *data, sw_answer *answer);

#endif

#endif
