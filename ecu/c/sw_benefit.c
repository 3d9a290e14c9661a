/* The benefit check. It judges whether control reduces the suction on the base and the pressure differences between
 * mirrored sensors, compared with the wake while the jets are shut. ecu/benefit_check.py gives the reasons.
 */
#include "sw_ecu_parts.h"

#if SW_BENEFIT_CHECK

typedef struct {
    double suction; /* mean pressure on the base, in Cp or relative to the release's wake */
    double swing;   /* mean |pressure difference| of mirrored sensors, in the same unit */
} measured;

static double magnitude(double value) { return value < 0.0 ? -value : value; }

/* Returns suction and swing of the release's wake without jets at a speed, in Cp, interpolated linearly. */
static measured stated_at(const sw_release *release, double speed)
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

/* Measures suction and swing. Divides them by their values in the release's wake without jets at this speed. */
static measured measure(const sw_release *release, const double *cp, double speed)
{
    const measured stated = stated_at(release, speed);
    measured now = {0.0, 0.0};
    for (int i = 0; i < SW_BASES; i++) now.suction += cp[release->base[i]];
    for (int i = 0; i < SW_MIRRORED_PAIRS; i++) now.swing += magnitude(cp[release->pairs[i][0]] - cp[release->pairs[i][1]]);
    now.suction /= (double)SW_BASES;
    now.swing /= (double)SW_MIRRORED_PAIRS;
    now.suction /= stated.suction;
    now.swing /= stated.swing;
    return now;
}

static uint32_t at_most(uint32_t count, uint32_t most) { return count < most ? count : most; }

/* Returns `mean`. If too few periods without control were measured, returns at least 1, the release's own value. */
static double resting(const sw_benefit *benefit, double mean)
{
    return benefit->rested < SW_PROVEN_PERIODS && mean < 1.0 ? 1.0 : mean;
}

static int helps(const sw_benefit *benefit)
{
    const double suction = resting(benefit, benefit->resting_suction);
    const double swing = resting(benefit, benefit->resting_swing);
    const int less_suction = suction - benefit->suction >= SW_LEAST_GAIN * magnitude(suction);
    const int calm = benefit->swing <= SW_MOST_SWING * swing;
    return less_suction & calm;
}

static uint32_t one_less(uint32_t count) { return count > 0u ? count - 1u : 0u; }

/* Adds this period to the means without control. The new means cover `over` periods. */
static void rested(sw_benefit *benefit, measured now, uint32_t over)
{
    benefit->resting_suction += (now.suction - benefit->resting_suction) / (double)over;
    benefit->resting_swing += (now.swing - benefit->resting_swing) / (double)over;
}

/* Clears the measurements under control. */
static void forget(sw_benefit *benefit)
{
    benefit->driven = 0;
    benefit->suction = 0.0;
    benefit->swing = 0.0;
    benefit->doubt = 0;
}

/* Measures a period in which the jets are shut. */
static void rest(sw_benefit *benefit, const sw_release *release, const double *cp, double speed)
{
    benefit->waking = one_less(benefit->waking);
    forget(benefit);
    if (cp == NULL || benefit->waking > 0u) return;
    benefit->rested = at_most(benefit->rested + 1u, SW_PROVEN_PERIODS);
    rested(benefit, measure(release, cp, speed), at_most(benefit->rested, SW_MEAN_PERIODS));
}

static uint32_t doubt_after(const sw_benefit *benefit)
{
    return helps(benefit) ? one_less(benefit->doubt) : at_most(benefit->doubt + 1u, SW_BENEFIT_DOUBT);
}

static void drive(sw_benefit *benefit, const sw_release *release, const double *cp, double speed)
{
    benefit->waking = SW_WAKE_PERIODS;
    if (cp == NULL) return;
    const measured now = measure(release, cp, speed);
    benefit->driven = at_most(benefit->driven + 1u, SW_FIRST_PERIOD);
    const double over = (double)at_most(benefit->driven, SW_MEAN_PERIODS);
    benefit->suction += (now.suction - benefit->suction) / over;
    benefit->swing += (now.swing - benefit->swing) / over;
    if (benefit->driven < SW_FIRST_PERIOD || benefit->rested == 0u) return;
    benefit->doubt = doubt_after(benefit);
    if (helps(benefit)) benefit->spent = one_less(benefit->spent);
    if (benefit->doubt >= SW_BENEFIT_DOUBT) benefit->tested_at = speed;
}

/* Runs a period of a test, which compares the means under control with the means after the jets were shut. */
static uint8_t test(sw_benefit *benefit, const sw_release *release, const double *cp, double speed)
{
    if (cp == NULL) return SW_REASON_NONE;
    benefit->waking = one_less(benefit->waking);
    benefit->spent = at_most(benefit->spent + 1u, SW_PATIENCE);
    const uint32_t over = SW_WAKE_PERIODS - benefit->waking;
    rested(benefit, measure(release, cp, speed), over);
    int goes_on = 0;
    if (over >= at_most(SW_FIRST_PERIOD, SW_WAKE_PERIODS)) {
        benefit->doubt = doubt_after(benefit);
        goes_on = benefit->doubt == 0u || magnitude(speed - benefit->tested_at) >= SW_MOVED;
    }
    const int latches = !goes_on && benefit->spent >= SW_PATIENCE;
    if (goes_on || latches) {
        forget(benefit);
        benefit->tested_at = 0.0;
    }
    return (uint8_t)(latches ? SW_REASON_NOT_HELPING : SW_REASON_NONE);
}

uint8_t sw_benefit_next(sw_benefit *benefit, const sw_release *release, const double *cp, double speed, int drives)
{
    if (benefit->tested_at > 0.0) return test(benefit, release, cp, speed);
    if (drives) {
        drive(benefit, release, cp, speed);
    } else {
        rest(benefit, release, cp, speed);
    }
    return SW_REASON_NONE;
}

#endif
