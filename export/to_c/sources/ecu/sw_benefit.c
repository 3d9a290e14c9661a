/* Whether control helps: the pressure on the base, and the differences of mirrored sensors, under control against what
 * they were with the jets shut. The twin of firmware_sim/ecu/benefit_check.py, which gives the reasons.
 */
#include "sw_ecu_parts.h"

#if SW_BENEFIT_CHECK

typedef struct {
    double base;  /* mean pressure on the base */
    double swing; /* mean magnitude of the differences of mirrored sensors */
} measured;

static double magnitude(double value) { return value < 0.0 ? -value : value; }

/* What base and swing are without jets at a speed, as shares of the design speed's; linear in between. */
static measured shares_at(const sw_release *release, double speed)
{
    const double *before = release->resting[0];
    for (int i = 0; i < SW_RESTING_SPEEDS; i++) {
        const double *after = release->resting[i];
        if (speed < after[0]) {
            const double share = after[0] > before[0] ? (speed - before[0]) / (after[0] - before[0]) : 0.0;
            const measured between = {before[1] + share * (after[1] - before[1]),
                                      before[2] + share * (after[2] - before[2])};
            return between;
        }
        before = after;
    }
    const measured last = {before[1], before[2]};
    return last;
}

/* As at the design speed. */
static measured measure(const sw_release *release, const double *cp, double speed)
{
    const measured shares = shares_at(release, speed);
    measured now = {0.0, 0.0};
    for (int i = 0; i < SW_BASES; i++) now.base += cp[release->base[i]];
    for (int i = 0; i < SW_MIRRORED_PAIRS; i++) now.swing += magnitude(cp[release->pairs[i][0]] - cp[release->pairs[i][1]]);
    now.base /= (double)SW_BASES;
    now.swing /= (double)SW_MIRRORED_PAIRS;
    now.base /= shares.base;
    now.swing /= shares.swing;
    return now;
}

static uint32_t at_most(uint32_t count, uint32_t most) { return count < most ? count : most; }

static int helps(const sw_benefit *benefit)
{
    const double gained = benefit->base - benefit->resting_base;
    const int less_suction = gained >= SW_LEAST_GAIN * magnitude(benefit->resting_base);
    const int calm = benefit->swing <= SW_MOST_SWING * benefit->resting_swing;
    return less_suction & calm;
}

/* The jets are shut. */
static void rest(sw_benefit *benefit, const sw_release *release, const double *cp, double speed)
{
    if (benefit->waking > 0u) benefit->waking--;
    benefit->driven = 0;
    benefit->base = 0.0;
    benefit->swing = 0.0;
    benefit->doubt = 0;
    if (cp == NULL || benefit->waking > 0u) return;
    const measured now = measure(release, cp, speed);
    benefit->rested = at_most(benefit->rested + 1u, SW_MEAN_PERIODS);
    benefit->resting_base += (now.base - benefit->resting_base) / (double)benefit->rested;
    benefit->resting_swing += (now.swing - benefit->resting_swing) / (double)benefit->rested;
}

static void drive(sw_benefit *benefit, const sw_release *release, const double *cp, double speed)
{
    benefit->waking = SW_WAKE_PERIODS;
    if (cp == NULL) return;
    const measured now = measure(release, cp, speed);
    benefit->driven = at_most(benefit->driven + 1u, SW_FIRST_PERIOD);
    const double over = (double)at_most(benefit->driven, SW_MEAN_PERIODS);
    benefit->base += (now.base - benefit->base) / over;
    benefit->swing += (now.swing - benefit->swing) / over;
}

uint8_t sw_benefit_next(sw_benefit *benefit, const sw_release *release, const double *cp, double speed, int drives)
{
    if (!drives) {
        rest(benefit, release, cp, speed);
        return SW_REASON_NONE;
    }
    drive(benefit, release, cp, speed);
    if (cp == NULL || benefit->driven < SW_FIRST_PERIOD || benefit->rested == 0u) return SW_REASON_NONE;
    if (!helps(benefit)) {
        benefit->doubt = at_most(benefit->doubt + 1u, SW_BENEFIT_DOUBT);
    } else if (benefit->doubt > 0u) {
        benefit->doubt--;
    } else {
        /* No doubt stays none. */
    }
    return (uint8_t)(benefit->doubt >= SW_BENEFIT_DOUBT ? SW_REASON_NOT_HELPING : SW_REASON_NONE);
}

#endif
