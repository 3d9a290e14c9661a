/* The memory of XCP: any command, any address; nothing is read or written outside the calibration and the measured values.
 */
#include "bytes_model.h"

#include "sw_xcp_memory.c"

static sw_xcp_memory memory;

void sw_calibrating_bytes(const sw_calibrating *of, uint8_t page, uint32_t at, uint32_t length, uint8_t *bytes)
{
    (void)of, (void)page;
    PROVE(length <= sizeof(sw_calibration) && at <= sizeof(sw_calibration) - length);
    sw_bytes_fill(bytes, nondet_uchar(), length);
}

int sw_calibrating_write_bytes(sw_calibrating *of, uint32_t at, const uint8_t *data, uint32_t length)
{
    (void)of, (void)touch(data, length);
    PROVE(length <= SW_XCP_MAX_CTO - 2u && at <= sizeof(sw_calibration) - length);
    PROVE(memory.page == SW_PAGE_WORKING);
    return nondet_int();
}

void sw_calibrating_select(sw_calibrating *of, uint8_t page) { of->page = page; }
void sw_calibrating_copy_release(sw_calibrating *of) { of->is_changed = 1; }
uint32_t sw_crc32(uint32_t crc, const uint8_t *data, uint32_t length) { return (void)touch(data, length), crc; }

void any_command(void)
{
    static const uint8_t shortest[][3] = SW_XCP_COMMANDS;
    static const char text[] = SW_XCP_EVENT_NAME;
    static sw_calibrating calibrating;
    static sw_daq daq;
    sw_xcp_memory any;
    uint8_t data[SW_XCP_MAX_CTO], bytes[SW_XCP_MAX_CTO];
    sw_answer answer = {bytes, sizeof bytes, 1};
    const uint32_t length = nondet_uint(), row = nondet_uint();
    memory = any;
    memory.calibrating = &calibrating;
    memory.daq = &daq;
    memory.text = text;
    ASSUME(memory.text_bytes < sizeof text && memory.page <= SW_PAGE_REFERENCE);
    ASSUME(row < sizeof shortest / sizeof shortest[0] && data[0] == shortest[row][0] && data[0] > SW_XCP_SET_DAQ_PTR);
    ASSUME(length >= shortest[row][1] && length <= SW_XCP_MAX_CTO);
    (void)sw_xcp_memory_command(&memory, data, length, &answer);
    PROVE(answer.length <= SW_XCP_MAX_CTO && memory.page <= SW_PAGE_REFERENCE);
    PROVE(calibrating.page <= SW_PAGE_REFERENCE);
}
