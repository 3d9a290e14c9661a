/* The simulated vehicle of the FMU with signals: it sends the FMU's inputs as protected frames, once a period. */
#include <string.h>

#include "sw_codec_bytes.h"
#include "sw_fmu.h"

fmi3String fmu_begun(fmu_memory *kept) { return NULL; }

/* A period that begins less than 1 us before the end of a communication step belongs to the next communication step. */
int fmu_is_due(const fmu_memory *kept, double until_ns) { return (double)kept->next_ns < until_ns - 1e3; }

/* The FMU has no bus: the outputs show everything that the ECU sends. */
void fmu_sent(fmu_memory *kept, const sw_frame *frames, int count) {}
int fmu_reached(fmu_instance *fmu, double until_ns) { return 0; }
int fmu_is_possible(const fmu_side *side) { return 1; }

/* Writes the bits of a signal. Bits are numbered from the lowest bit of the first byte on, as in the DBC. */
static void put(uint8_t *data, uint32_t reference, int32_t steps)
{
    const variable *signal = &fmu_variables[reference];
    for (int i = 0; i < signal->bits; i++) {
        const int bit = signal->start + i;
        data[bit / 8] |= (uint8_t)((((uint32_t)steps >> i) & 1u) << (bit % 8));
    }
}

/* Rounds to a whole number, half to even; returns `otherwise` for a number outside the bounds, or for NaN. */
static int32_t nearest(double value, int32_t least, int32_t most, int32_t otherwise)
{
    if (!(value > (double)least - 1.0 && value < (double)most + 1.0)) return otherwise;
    const int32_t whole = (int32_t)value;
    const double rest = value - (double)whole;
    const int is_odd = whole % 2 != 0;
    int32_t found = whole;
    if (rest > 0.5 || (rest >= 0.5 && is_odd)) found = whole + 1;
    if (rest < -0.5 || (rest <= -0.5 && is_odd)) found = whole - 1;
    return found >= least && found <= most ? found : otherwise;
}

/* Converts an age in s to units of its signal. For CAN FD the age is rounded to the nearest unit. The units of the
 * classic set are coarse, so the age is rounded up: no pressure then looks fresher than it is. NaN and too large ages
 * become the largest value.
 */
static int32_t age_steps(double seconds)
{
    const double most_ns = (double)SW_FMU_AGE_LIMIT * (double)SW_AGE_RESOLUTION_NS;
    if (!(seconds * 1e9 < most_ns)) return SW_FMU_AGE_LIMIT;
    if (seconds <= 0.0) return 0;
    const int64_t age_ns = (int64_t)(seconds * 1e9 + 0.5);
    const int64_t up = SW_FRAMES_FD ? SW_AGE_RESOLUTION_NS / 2 : SW_AGE_RESOLUTION_NS - 1;
    return (int32_t)((age_ns + up) / SW_AGE_RESOLUTION_NS);
}

/* --- The vehicle's frames --- */

static void start_frame(sw_frame *frame, uint32_t id, int length, int64_t now_ns)
{
    (void)memset(frame, 0, sizeof *frame);
    frame->timestamp_ns = now_ns;
    frame->id = id;
    frame->is_fd = SW_FRAMES_FD;
    frame->length = (uint8_t)length;
}

static uint8_t next_counter(uint8_t counter) { return (uint8_t)((counter + 1u) % SW_E2E_COUNTERS); }

/* Writes the pressures; a pressure beyond a transducer's range is limited to the range and marked as invalid. */
static void write_pressures(fmu_memory *kept, sw_frame *frame)
{
    start_frame(frame, SW_PRESSURE_ID, SW_PRESSURE_BYTES, kept->next_ns);
    for (uint32_t i = 0; i < SW_SENSORS; i++) {
        const double steps = kept->values[SW_FMU_PRESSURE + i] / SW_PRESSURE_RESOLUTION_PA;
        const int32_t beyond = steps > 0.0 ? SW_FMU_PRESSURE_LIMIT : steps < 0.0 ? -SW_FMU_PRESSURE_LIMIT : 0;
        const int is_within = steps >= (double)-SW_FMU_PRESSURE_LIMIT && steps <= (double)SW_FMU_PRESSURE_LIMIT;
        const int is_valid = is_within && kept->values[SW_FMU_VALID + i] != 0.0;
        int32_t sent = nearest(steps, -SW_FMU_PRESSURE_LIMIT, SW_FMU_PRESSURE_LIMIT, beyond);
#if !SW_FRAMES_FD
        if (!is_valid) sent = SW_PRESSURE_INVALID;
#endif
        put(frame->data, SW_FMU_PRESSURE + i, sent);
        put(frame->data, SW_FMU_VALID + i, is_valid);
    }
    put(frame->data, SW_FMU_ENABLE_REQUEST, kept->values[SW_FMU_ENABLE_REQUEST] != 0.0);
    put(frame->data, SW_FMU_PRESSURE_AGE, age_steps(kept->values[SW_FMU_PRESSURE_AGE]));
    sw_e2e_protect(frame->data, SW_PRESSURE_BYTES, SW_PRESSURE_DATA_ID, kept->side.pressure_counter);
    kept->side.pressure_counter = next_counter(kept->side.pressure_counter);
}

/* Writes the speed. A speed or a density outside the range of its signal is sent as unknown. */
static void write_speed(fmu_memory *kept, sw_frame *frame)
{
    const int32_t unknown = (int32_t)SW_SPEED_UNKNOWN;
    const double speed = kept->values[SW_FMU_VEHICLE_SPEED] / SW_SPEED_RESOLUTION;
    const double density = kept->values[SW_FMU_AIR_DENSITY] / SW_DENSITY_RESOLUTION;
    start_frame(frame, SW_SPEED_ID, SW_SPEED_BYTES, kept->next_ns);
    put(frame->data, SW_FMU_VEHICLE_SPEED, nearest(speed, 0, unknown - 1, unknown));
    put(frame->data, SW_FMU_AIR_DENSITY, nearest(density, 1, 255, 0));
    sw_e2e_protect(frame->data, SW_SPEED_BYTES, SW_SPEED_DATA_ID, kept->side.speed_counter);
    kept->side.speed_counter = next_counter(kept->side.speed_counter);
}

int fmu_received(fmu_memory *kept, sw_frame frames[FMU_MOST_FRAMES], sw_surroundings *around)
{
    int count = 0;
    if (kept->values[SW_FMU_SEND_PRESSURES] != 0.0) write_pressures(kept, &frames[count++]);
    if (kept->values[SW_FMU_SEND_SPEED] != 0.0) write_speed(kept, &frames[count++]);
    return count;
}
