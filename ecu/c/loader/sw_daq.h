/* Measurement by XCP (DAQ): one dynamic list, and one event, the end of a control period. The twin of
 * can_bridge/calibration/daq.py and measured.py.
 *
 * A period that ends before the frames of another one have left is left out, so that all frames of a period are of that
 * period.
 */
#ifndef SW_DAQ_H
#define SW_DAQ_H

#include <stdint.h>

#include "sw_bytes.h"
#include "sw_ecu_state.h"
#include "sw_uds_settings.h"

#if SW_XCP

/* What is read and measured of a control period, as it stands in memory: little-endian. */
typedef struct {
    float pressures[SW_SENSORS]; /* Cp in the row that was planned on */
    float command;               /* that was sent, in U_inf W */
    uint8_t mode;                /* SW_MODE_ */
    uint8_t reason;              /* SW_REASON_ */
    uint8_t gated;               /* SW_GATED_, bits */
    uint8_t reserved;
    sw_calibration calibration; /* in force in this period */
} sw_measured;

typedef struct {
    uint8_t at; /* in sw_measured */
    uint8_t bytes; /* 0: not written yet */
} sw_daq_entry;

typedef struct {
    sw_measured measured;
    uint8_t stage; /* how far the allocation has come */
    uint8_t lists;
    uint8_t odts;
    uint8_t used; /* entries */
    uint8_t has_pointer;
    uint8_t odt; /* that is written next, with its */
    uint8_t entry;
    uint8_t is_selected;
    uint8_t is_running;
    uint8_t next; /* ODT that is sent next; `odts` when nothing is due */
    uint8_t first[SW_XCP_ODTS]; /* entry of each */
    uint8_t count[SW_XCP_ODTS];
    sw_daq_entry entries[SW_XCP_ENTRIES];
} sw_daq;

/* Stops, and forgets the list: at the end of a connection. */
void sw_daq_free(sw_daq *daq);

/* Takes a control period that has ended. */
void sw_daq_sample(sw_daq *daq, const sw_ecu *ecu, uint8_t mode);

/* The next packet of the period, SW_XCP_MAX_CTO bytes at most; how many, 0 when nothing is due. */
uint32_t sw_daq_packet(sw_daq *daq, uint8_t *packet);

/* Answers a command of measurement, whose length was looked at: SW_XCP_DONE, or the SW_XCP_ERROR_ of the refusal. */
uint8_t sw_daq_command(sw_daq *daq, const uint8_t *data, sw_answer *answer);

#endif

#endif
