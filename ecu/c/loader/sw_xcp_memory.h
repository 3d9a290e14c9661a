/* The memory that a calibration tool sees: the calibration's two pages, and the latest control period. This file
 * corresponds to the handlers in can_bridge/calibration/xcp_slave.py.
 */
#ifndef SW_XCP_MEMORY_H
#define SW_XCP_MEMORY_H

#include <stdint.h>

#include "sw_calibrating.h"
#include "sw_daq.h"

#if SW_XCP

typedef struct {
    sw_calibrating *calibrating;
    const sw_daq *daq;
    const char *text; /* rest of a name that UPLOAD returns next */
    uint32_t address; /* memory transfer address (MTA) */
    uint8_t text_bytes;
    uint8_t page; /* page that the tool reads and writes */
} sw_xcp_memory;

/* Resets the address, the name and the page after a connection. */
void sw_xcp_memory_end(sw_xcp_memory *memory);

/* Sets the name that UPLOAD returns next. */
void sw_xcp_memory_text(sw_xcp_memory *memory, const char *text, uint32_t bytes);

/* Answers a calibration command; the caller checks its length. Returns SW_XCP_DONE or an SW_XCP_ERROR_ code. */
uint8_t sw_xcp_memory_command(sw_xcp_memory *memory, const uint8_t *data, uint32_t length, sw_answer *answer);

#endif

#endif
