/* The timing check of the ECU's steps. It detects skipped periods, early steps, and a clock that stops or goes back.
 *
 * It adds up the lateness of the steps. A sum of half a period counts as a skipped period. Every step then reduces the
 * remaining sum by an eighth. This file corresponds to ecu/timing.py, which gives the reasons.
 */
#include "sw_counts.h"
#include "sw_ecu_parts.h"

/* A mask with one bit for each of the latest steps that the check considers. */
#define JUDGED (UINT32_MAX >> (32 - SW_DEADLINE_WINDOW))

/* Divides and rounds down, as Python does, whereas C rounds towards zero. */
static int64_t floor_divided(int64_t value, int64_t by)
{
    const int64_t towards_zero = value / by;
    return value % by < 0 ? towards_zero - 1 : towards_zero;
}

/* Limits a time, so that the difference of two stored times fits into 64 bits. */
static int64_t within_limits(int64_t now_ns)
{
    if (now_ns < 0) return -1;
    return now_ns > SW_LATEST_NS ? SW_LATEST_NS : now_ns;
}

static void wrong_clock(sw_timing *timing, int64_t now_ns)
{
    timing->has_step = 1;
    timing->step_ns = within_limits(now_ns);
    timing->lag_ns = 0;
    timing->skipped = 0;
    timing->fault = SW_REASON_CLOCK;
}

static void first_step(sw_timing *timing, int64_t now_ns)
{
    timing->has_step = 1;
    timing->step_ns = now_ns;
    timing->lag_ns = 0;
    timing->off_time = 0;
    timing->skipped = 0;
    timing->fault = SW_REASON_NONE;
}

void sw_timing_next(sw_timing *timing, int64_t now_ns)
{
    if (now_ns < 0 || now_ns > SW_LATEST_NS || (timing->has_step && now_ns <= timing->step_ns)) {
        wrong_clock(timing, now_ns);
        return;
    }
    if (!timing->has_step) {
        first_step(timing, now_ns);
        return;
    }
    const int64_t lag_ns = timing->lag_ns + now_ns - timing->step_ns - SW_PERIOD_NS;
    const int64_t whole = floor_divided(2 * lag_ns + SW_PERIOD_NS, 2 * SW_PERIOD_NS); /* rounded to periods */
    const uint32_t off_time = ((timing->off_time << 1) | (whole != 0 ? 1u : 0u)) & JUDGED;
    const int too_often = whole != 0 && sw_bit_count(off_time) >= SW_DEADLINE_MISSES;
    /* True after a pause longer than hold and decay together; the vehicle has then shut the jets. */
    const int away = whole > SW_HOLD_PERIODS + SW_DECAY_PERIODS;
    timing->fault = SW_REASON_NONE;
    if (too_often || away) timing->fault = whole > 0 ? SW_REASON_DEADLINE : SW_REASON_CLOCK;
    timing->step_ns = now_ns;
    timing->lag_ns = floor_divided((lag_ns - whole * SW_PERIOD_NS) * 7, 8);
    timing->off_time = off_time;
    timing->skipped = whole > 0 ? whole : 0;
}
