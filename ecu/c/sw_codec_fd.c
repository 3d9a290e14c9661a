/* The messages of the CAN FD set, as laid out in the DBC. */
#include "sw_codec_bytes.h"

#if SW_FRAMES_FD

#if SW_SENSORS != 4
#error "a Pressure message has four pressures"
#endif

#define FLAGS 3 /* the byte after the header, in all messages */

/* Constants of the message Pressure. */
#define VALID 0x0fu
#define ENABLE_REQUEST 0x10u
#define PRESSURES 4 /* first byte of the pressures */
#define AGE 12

/* Constants of the message VehicleSpeed. */
#define DENSITY 3 /* first byte of this signal; the following names are first bytes, too */
#define SPEED 4
#define SPEED_AGE 6

/* Constants of the message JetCommand. */
#define MODE 0x07u
#define ENABLE 0x08u
#define COUNTER_VALID 0x10u
#define NEXT_PERIOD 0x20u

void sw_parse_pressure(const uint8_t *data, sw_pressure *pressure)
{
    for (int i = 0; i < SW_SENSORS; i++) {
        const int32_t steps = sw_signed(sw_word(&data[PRESSURES + 2 * i]), 0x8000u);
        pressure->pressure_pa[i] = (double)steps * SW_PRESSURE_RESOLUTION_PA;
    }
    pressure->valid = (uint8_t)(data[FLAGS] & VALID);
    pressure->enable_request = (uint8_t)((data[FLAGS] & ENABLE_REQUEST) != 0u);
    pressure->age_ns = (int64_t)sw_word(&data[AGE]) * SW_AGE_RESOLUTION_NS;
}

#if SW_PAST > 0
void sw_parse_speed(const uint8_t *data, sw_speed *speed)
{
    const uint32_t steps = sw_word(&data[SPEED]);
    speed->known = (uint8_t)(steps != SW_SPEED_UNKNOWN);
    speed->speed_m_per_s = speed->known ? (double)steps * SW_SPEED_RESOLUTION : 0.0;
    speed->density_kg_per_m3 = (double)data[DENSITY] * SW_DENSITY_RESOLUTION;
    speed->age_ns = (int64_t)sw_word(&data[SPEED_AGE]) * SW_AGE_RESOLUTION_NS;
}
#endif

void sw_emit_command(uint8_t *data, const sw_jet_command *command)
{
    uint32_t flags = (uint32_t)command->mode & MODE;
    flags |= command->enable ? ENABLE : 0u;
    flags |= command->has_counter ? COUNTER_VALID : 0u;
    flags |= SW_PLAN_AHEAD ? NEXT_PERIOD : 0u;
    sw_clear(data, SW_COMMAND_BYTES);
    data[FLAGS] = (uint8_t)flags;
    sw_put_word(&data[4], (uint32_t)command->flow);
    data[6] = command->has_counter ? command->pressure_counter : (uint8_t)0;
}

void sw_emit_status(uint8_t *data, const sw_ecu_status *status)
{
    sw_clear(data, SW_STATUS_BYTES);
    data[FLAGS] = (uint8_t)(status->state & 0x0fu);
    data[4] = status->reason;
    data[5] = (uint8_t)sw_at_most(status->bus_off, SW_BUS_OFF_LIMIT);
    sw_put_word(&data[6], sw_at_most(status->overruns, SW_COUNT_LIMIT));
    sw_put_word(&data[8], sw_at_most(status->missed, SW_COUNT_LIMIT));
    sw_put_word(&data[10], sw_at_most(status->crc_errors, SW_COUNT_LIMIT));
    sw_put_word(&data[12], status->bundle_hash);
    sw_put_word(&data[14], status->bundle_hash >> 16);
    sw_put_word(&data[16], sw_at_most(status->refused, SW_COUNT_LIMIT));
#if SW_SECOC
    sw_put_word(&data[18], sw_at_most(status->not_authentic, SW_COUNT_LIMIT));
#endif
    data[20] = (uint8_t)sw_at_most(status->tx_errors, SW_ERROR_LIMIT);
    data[21] = (uint8_t)sw_at_most(status->rx_errors, SW_ERROR_LIMIT);
    data[22] = (uint8_t)(status->set_aside & 0x0fu);
}

#endif
