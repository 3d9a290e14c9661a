/* The messages of the bus: any bytes in, any values out. */
#include "prove.h"

#include "sw_codec_fd.c"

void any_pressure(void)
{
    uint8_t data[SW_PRESSURE_BYTES];
    sw_pressure pressure;
    sw_parse_pressure(data, &pressure);
    PROVE(pressure.valid < 1u << SW_SENSORS);
    PROVE(pressure.enable_request <= 1u);
    PROVE(pressure.age_ns >= 0 && pressure.age_ns <= 65535 * (int64_t)SW_AGE_RESOLUTION_NS);
}

void any_speed(void)
{
    uint8_t data[SW_SPEED_BYTES];
    sw_speed speed;
    sw_parse_speed(data, &speed);
    PROVE(speed.known <= 1u);
    PROVE(speed.age_ns >= 0);
}

void any_command(void)
{
    uint8_t data[SW_COMMAND_BYTES];
    sw_jet_command command;
    sw_emit_command(data, &command);
    PROVE(data[0] == 0u && data[1] == 0u && data[2] == 0u); /* the header's place */
    PROVE((uint16_t)sw_word(&data[4]) == (uint16_t)command.flow);
    PROVE(((data[3] & ENABLE) != 0u) == (command.enable != 0u));
}

void any_status(void)
{
    uint8_t data[SW_STATUS_BYTES];
    sw_ecu_status status;
    sw_emit_status(data, &status);
    PROVE(sw_word(&data[6]) == sw_at_most(status.overruns, SW_COUNT_LIMIT)); /* stays at its limit */
    PROVE(data[4] == status.reason);
}

int main(void)
{
    any_pressure();
    any_speed();
    any_command();
    any_status();
    return 0;
}
