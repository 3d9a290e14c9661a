/* End-to-end protection: any bytes from the bus, and one wrong bit. */
#include "prove.h"

#include "sw_e2e.c"

void any_frame(void)
{
    uint8_t data[SW_FRAME_BYTES];
    const int length = nondet_int();
    ASSUME(length >= 0 && length <= SW_PRESSURE_BYTES);
    (void)sw_e2e_check(data, length, SW_PRESSURE_DATA_ID);
    if (length < HEADER) PROVE(!sw_e2e_check(data, length, SW_PRESSURE_DATA_ID));
}

/* What is protected is taken, with its counter; with one bit of it wrong it is not. */
void one_bit(void)
{
    uint8_t data[SW_COMMAND_BYTES];
    const uint8_t counter = nondet_uchar(), place = nondet_uchar(), bit = nondet_uchar();
    ASSUME(place < SW_COMMAND_BYTES && bit < 8u);
    sw_e2e_protect(data, SW_COMMAND_BYTES, SW_COMMAND_DATA_ID, counter);
    PROVE(sw_e2e_check(data, SW_COMMAND_BYTES, SW_COMMAND_DATA_ID));
    PROVE(sw_e2e_counter(data) == counter);
    data[place] = (uint8_t)(data[place] ^ (1u << bit));
    PROVE(!sw_e2e_check(data, SW_COMMAND_BYTES, SW_COMMAND_DATA_ID));
}
