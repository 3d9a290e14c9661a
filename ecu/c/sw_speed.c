/* The vehicle's speed through the air, for the conversion of pressures to coefficients and of actions to flow rates. If
 * no new speed is accepted, the last accepted speed stays in force for a limited time. This file corresponds to
 * ecu/speed_reception.py.
 */
#include "sw_ecu_parts.h"

#if SW_PAST > 0

/* Returns the time since the latest measurement; 0 if the clock is earlier than the measurement. */
static uint64_t age_of(const sw_speed_state *speed, int64_t now_ns)
{
    return now_ns > speed->measured_ns ? (uint64_t)now_ns - (uint64_t)speed->measured_ns : 0u;
}

/* Returns whether a vehicle can change from the last accepted speed to this speed in the elapsed time. */
static int is_plausible(const sw_speed_state *speed, const sw_release *release, double speed_m_per_s, int64_t now_ns)
{
    const double elapsed_s = (double)age_of(speed, now_ns) * 1e-9;
    /* Over a time shorter than SW_SHORTEST_S, rounding or a late frame would look like an acceleration. */
    const double most = SW_MOST_ACCELERATION * (elapsed_s > SW_SHORTEST_S ? elapsed_s : SW_SHORTEST_S);
    const double change = speed_m_per_s - speed->ratio * release->design_speed;
    return !speed->known || (change <= most && change >= -most);
}

/* Accepts the speed of a frame, unless it is old, unknown or implausible. */
static void believe(sw_speed_state *speed, const sw_release *release, const sw_frame *frame, int64_t now_ns)
{
    sw_speed stated;
    sw_parse_speed(frame->data, &stated);
    if (stated.known && sw_is_fresh(frame->timestamp_ns, stated.age_ns, now_ns, SW_OLDEST_SPEED_NS) &&
        is_plausible(speed, release, stated.speed_m_per_s, now_ns)) {
        speed->known = 1;
        speed->ratio = stated.speed_m_per_s / release->design_speed;
        speed->density = stated.density_kg_per_m3 > 0.0 ? stated.density_kg_per_m3 : release->design_density;
        speed->measured_ns = frame->timestamp_ns - stated.age_ns;
    }
}

void sw_speed_next(sw_speed_state *speed, const sw_release *release, const sw_frame *frames, int count,
                   int64_t now_ns SW_BY_KEY(const sw_secoc *secoc))
{
#if SW_SECOC
    static const sw_message message = {SW_SPEED_ID, SW_SPEED_BYTES, SW_SPEED_DATA_ID, SW_SPEED_SECURED};
#else
    static const sw_message message = {SW_SPEED_ID, SW_SPEED_BYTES, SW_SPEED_DATA_ID};
#endif
    const sw_frame *frame = sw_receive(&speed->receiver, &message, frames, count SW_BY_KEY(secoc));
    /* If the clock went back, the age of the last accepted speed is unknown. */
    if (now_ns < speed->measured_ns) speed->known = 0;
    if (frame != NULL && speed->receiver.stream == SW_VALID) believe(speed, release, frame, now_ns);
    if (!speed->known || age_of(speed, now_ns) > (uint64_t)SW_OLDEST_SPEED_NS) {
        speed->known = 0;
        speed->ratio = 0.0;
    } else {
        const double margin = speed->is_off ? 0.0 : SW_SPEED_MARGIN;
        speed->is_off = (uint8_t)!(speed->ratio >= release->slowest * (1.0 - margin) &&
                                   speed->ratio <= release->fastest * (1.0 + margin));
    }
}

double sw_speed_present(const sw_speed_state *speed, const sw_release *release)
{
    if (!speed->known || speed->is_off) return 1.0;
#if SW_AIR_SPEED
    const double ratio = speed->ratio * speed->air.correction;
#else
    const double ratio = speed->ratio;
#endif
    if (ratio < release->slowest) return release->slowest;
    return ratio > release->fastest ? release->fastest : ratio;
}

double sw_speed_dynamic_pressure(const sw_speed_state *speed, const sw_release *release)
{
    const double through_air = sw_speed_present(speed, release) * release->design_speed;
    return speed->known ? 0.5 * speed->density * through_air * through_air : 0.0;
}

/* --- The estimate of the air speed, with the terms of contract/controller/air_speed.py --- */

#if SW_AIR_SPEED

enum { PAIRS = SW_SENSORS / 2, SIGNALS = PAIRS + 1 };

/* Returns a signal of a window's row: a difference between mirrored sensors, or the action. */
static double signal_of(const double row[SW_COLUMNS], int i)
{
    return i < PAIRS ? row[2 * i] - row[2 * i + 1] : row[SW_SENSORS];
}

/* Returns a feature of the newest row: a sum of mirrored pressures, or a product of a signal and an earlier signal. */
static double feature_of(const sw_memory *memory, int n)
{
    static const uint8_t lags[] = SW_AIR_LAGS;
    const double *newest = memory->window[SW_WINDOW - 1];
    if (n < PAIRS) return newest[2 * n] + newest[2 * n + 1];
    const int product = n - PAIRS, both = product % (SIGNALS * SIGNALS);
    const double *earlier = memory->window[SW_WINDOW - 1 - (int)lags[product / (SIGNALS * SIGNALS)]];
    return signal_of(newest, both / SIGNALS) * signal_of(earlier, both % SIGNALS);
}

static double between(double value, double least, double most)
{
    const double raised = value < least ? least : value;
    return raised > most ? most : raised;
}

/* Returns the logarithm of (speed in use / air speed). */
static double estimate_of(const double means[SW_AIR_FEATURES], const float weights[SW_AIR_WEIGHTS])
{
    double sum = 0.0;
    for (int n = 0; n < SW_AIR_WEIGHTS; n++) {
        double term = 1.0;
        if (n < SW_AIR_FEATURES) {
            term = means[n];
        } else if (n < SW_AIR_FEATURES + PAIRS) {
            term = means[n - SW_AIR_FEATURES] * means[n - SW_AIR_FEATURES];
        } else {
            /* The last term is the constant. */
        }
        sum += (double)weights[n] * term;
    }
    return sum;
}

/* Limits a correction, which must also not move the speed in use out of the release's range. */
static double limited(double correction, double ratio, const sw_release *release)
{
    const double least = between(release->slowest / ratio, 1.0 - SW_MOST_CORRECTION, 1.0);
    return between(correction, least, between(release->fastest / ratio, 1.0, 1.0 + SW_MOST_CORRECTION));
}

void sw_air_speed_next(sw_speed_state *speed, const sw_release *release, const sw_memory *memory, int is_sound,
                       int drives)
{
    sw_air_speed *air = &speed->air;
    if (!drives) air->driven = 0;
    if (!drives || !is_sound) return;
    if (air->driven < SW_AIR_FIRST_PERIOD) air->driven++;
    const uint32_t over = air->driven < SW_AIR_MEAN_PERIODS ? air->driven : SW_AIR_MEAN_PERIODS;
    for (int n = 0; n < SW_AIR_FEATURES; n++) {
        const double before = air->driven == 1u ? 0.0 : air->means[n];
        air->means[n] = before + (feature_of(memory, n) - before) / (double)over;
    }
    if (air->driven == SW_AIR_FIRST_PERIOD) {
        const double estimate = estimate_of(air->means, release->air_speed);
        const double rest = estimate - between(estimate, -SW_AIR_TOLERATED, SW_AIR_TOLERATED);
        const double next = air->correction - SW_AIR_RATE * air->correction * between(rest, -SW_AIR_MOST_REST, SW_AIR_MOST_REST);
        air->correction = limited(next, speed->ratio, release);
    }
}

#endif

#endif
