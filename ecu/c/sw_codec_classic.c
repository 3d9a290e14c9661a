/* The messages of the classic set, as laid out in the DBC; each has eight bytes. */
#include "sw_codec_bytes.h"

#if !SW_FRAMES_FD

#if SW_SENSORS != 4
#error "a PressureClassic message has four pressures"
#endif

#define HEAD 1 /* byte whose lower half is the E2E counter */

/* Constants of the message PressureClassic. */
#define ENABLE_REQUEST 0x10u
#define AGE_LIMIT 7u /* largest value; it stands for this age and for all greater ages */
#define PRESSURES 2  /* first byte of the pressures; two pressures of 12 bits take three bytes */

/* Constants of the message VehicleSpeedClassic. */
#define DENSITY 3 /* first byte of this signal; the following names are first bytes, too */
#define SPEED 4
#define SPEED_AGE 6

/* Constants of the message JetCommandClassic. */
#define ENABLE 0x80u
#define COUNTER_VALID 0x01u
#define NEXT_PERIOD 0x02u

/* Returns the pressure of sensor i in units of the message's resolution. */
static int32_t steps_of(const uint8_t *data, int i)
{
    const uint32_t word = sw_word(&data[PRESSURES + 3 * i / 2]);
    return sw_signed((i % 2 == 0 ? word : word >> 4) & 0xfffu, 0x800u);
}

void sw_parse_pressure(const uint8_t *data, sw_pressure *pressure)
{
    const uint32_t age = (uint32_t)data[HEAD] >> 5;
    uint32_t valid = 0;
    for (int i = 0; i < SW_SENSORS; i++) {
        const int32_t steps = steps_of(data, i);
        const int is_valid = steps != SW_PRESSURE_INVALID;
        pressure->pressure_pa[i] = is_valid ? (double)steps * SW_PRESSURE_RESOLUTION_PA : 0.0;
        valid |= (uint32_t)is_valid << i;
    }
    pressure->valid = (uint8_t)valid;
    pressure->enable_request = (uint8_t)((data[HEAD] & ENABLE_REQUEST) != 0u);
    pressure->age_ns = age < AGE_LIMIT ? (int64_t)age * SW_AGE_RESOLUTION_NS : SW_STALE_NS;
}

#if SW_PAST > 0
void sw_parse_speed(const uint8_t *data, sw_speed *speed)
{
    const uint32_t steps = sw_word(&data[SPEED]);
    speed->known = (uint8_t)(steps != SW_SPEED_UNKNOWN);
    speed->speed_m_per_s = speed->known ? (double)steps * SW_SPEED_RESOLUTION : 0.0;
    speed->density_kg_per_m3 = (double)data[DENSITY] * SW_DENSITY_RESOLUTION;
    speed->age_ns = (int64_t)data[SPEED_AGE] * SW_AGE_RESOLUTION_NS;
}
#endif

void sw_emit_command(uint8_t *data, const sw_jet_command *command)
{
    uint32_t echo = command->has_counter ? COUNTER_VALID | (((uint32_t)command->pressure_counter & 0x0fu) << 4) : 0u;
    echo |= SW_PLAN_AHEAD ? NEXT_PERIOD : 0u;
    sw_clear(data, SW_COMMAND_BYTES);
    data[HEAD] = (uint8_t)((((uint32_t)command->mode & 0x07u) << 4) | (command->enable ? ENABLE : 0u));
    sw_put_word(&data[2], (uint32_t)command->flow);
    data[4] = (uint8_t)echo;
}

void sw_emit_status(uint8_t *data, const sw_ecu_status *status)
{
    const uint32_t overruns = sw_at_most(status->overruns, SW_COUNT_LIMIT);
    const uint32_t missed = sw_at_most(status->missed, SW_COUNT_LIMIT);
    const uint32_t crc_errors = sw_at_most(status->crc_errors, SW_COUNT_LIMIT);
    const uint32_t reason = status->reason;
    const uint32_t refused = sw_at_most(status->refused, SW_COUNT_LIMIT);
    sw_clear(data, SW_STATUS_BYTES);
    /* The lowest bit of the reason follows the state; the reason's other four bits are in the next byte. */
    data[HEAD] = (uint8_t)((((uint32_t)status->state & 0x07u) << 4) | ((reason & 0x01u) << 7));
    data[2] = (uint8_t)(((reason >> 1) & 0x0fu) | (sw_at_most(status->bus_off, SW_BUS_OFF_LIMIT) << 4));
    /* This word and the next byte have four counts of six bits. */
    sw_put_word(&data[3], overruns | (missed << 6) | (crc_errors << 12));
    data[5] = (uint8_t)((crc_errors >> 4) | (refused << 2));
    /* Only the upper half of the hash is sent. */
    sw_put_word(&data[6], status->bundle_hash >> 16);
}

#endif
