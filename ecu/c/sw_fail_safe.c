/* The fail-safe: a table of states and transitions decides on the ECU's mode in each control period.
 *
 * A period takes the first row whose start contains the present mode and whose condition is true. This file corresponds
 * to ecu/fail_safe.py, with the same rows, order and names.
 */
#include "sw_counts.h"
#include "sw_ecu_parts.h"

typedef enum {
    ALWAYS,
    UPDATING,  /* a new release is being written */
    OWN_FAULT, /* fault of clock, deadline, bus, sensors or controller; another ECU on the bus; control does not help */
    REARMED,   /* the request rises after at least SW_REARM_FRAMES consecutive periods with usable pressures */
    REARMED_FILLING,
    LOW,            /* control is not requested */
    NEVER_YET,      /* no usable pressures, and the request does not rise */
    LOW_AND_USABLE, /* usable pressures, and the request is low */
    STANDING,       /* usable pressures, and the request does not rise */
    INVALID,        /* the stream is not trusted */
    TOO_LONG,       /* pressures are missing for longer than the hold and decay periods together */
    TOO_MANY,       /* this period is lost, and SW_LOSS_LIMIT or more of the latest SW_LOSS_WINDOW periods are lost */
    FILLING,        /* the window is not full, the speed is out of the release's range, or a test runs */
    USABLE,         /* usable pressures */
    SHORT           /* pressures are missing for no longer than the hold periods */
} condition;

typedef enum {
    NO_REASON,
    QUIET, /* no reason; NOT_AUTHENTIC if no frame is authentic */
    WRITING,
    STANDS,  /* NOT_ARMED; NOT_AUTHENTIC if no frame is authentic */
    MISSING, /* reason why pressures are missing, or no reason */
    WAITING, /* like MISSING; OFF_SPEED at a speed out of range, NOT_HELPING in a test */
    OWN,     /* reason of the ECU's own fault */
    FIRST    /* the reason of the first fault stays */
} because;

typedef struct {
    uint16_t start; /* modes in which the row's transition may be taken, one bit each */
    uint8_t when;   /* condition of the transition */
    uint8_t to;     /* sw_operating_mode */
    uint8_t reason; /* origin of the reason: a value of `because` */
} transition;

/* The data on which the conditions depend: this period's inputs, and the counts that include this period. */
typedef struct {
    const sw_period_inputs *inputs;
    uint8_t request;
    uint8_t rises; /* whether the request was low before this period and is high now */
    uint8_t kept;  /* reason of the previous state */
    uint32_t misses;
    uint32_t good;
    int lost;
} period;

#define IN(mode) (1u << (unsigned)(mode))
#define INIT IN(SW_INIT)
#define STANDBY IN(SW_STANDBY)
#define ARMED IN(SW_ARMED)
#define WARMUP IN(SW_WARMUP)
#define CONTROL IN(SW_CONTROL)
#define HOLD IN(SW_HOLD)
#define DECAY IN(SW_DECAY)
#define FAULT IN(SW_FAULT)
#define UPDATE IN(SW_UPDATE)
#define WANTED (WARMUP | CONTROL | HOLD | DECAY) /* control is requested and there is no fault */

/* clang-format off */
static const transition transitions[] = {
    {UPDATE, ALWAYS, SW_UPDATE, WRITING},
    {INIT | STANDBY | ARMED | WARMUP | FAULT, UPDATING, SW_UPDATE, WRITING},
    {INIT | STANDBY | ARMED | WANTED, OWN_FAULT, SW_FAULT, OWN},
    {FAULT, OWN_FAULT, SW_FAULT, FIRST},
    /* The request is low, or it is high but not accepted. */
    {INIT, NEVER_YET, SW_INIT, QUIET},
    {INIT, LOW_AND_USABLE, SW_ARMED, QUIET},
    {INIT, STANDING, SW_STANDBY, STANDS},
    {STANDBY | ARMED | WANTED, LOW, SW_ARMED, QUIET},
    {STANDBY, ALWAYS, SW_STANDBY, STANDS},
    /* The request rises, or it is high and was accepted earlier. */
    {INIT | ARMED | WANTED, INVALID, SW_FAULT, MISSING},
    {INIT | ARMED | WANTED, TOO_LONG, SW_FAULT, MISSING},
    {INIT | ARMED | WANTED, TOO_MANY, SW_FAULT, MISSING},
    {INIT, ALWAYS, SW_WARMUP, WAITING},
    {ARMED | WANTED, FILLING, SW_WARMUP, WAITING},
    {ARMED | WANTED, USABLE, SW_CONTROL, NO_REASON},
    {ARMED | WARMUP | CONTROL | HOLD, SHORT, SW_HOLD, MISSING},
    {ARMED | WANTED, ALWAYS, SW_DECAY, MISSING},
    /* A latched fault ends or stays. */
    {FAULT, REARMED_FILLING, SW_WARMUP, WAITING},
    {FAULT, REARMED, SW_CONTROL, NO_REASON},
    {FAULT, ALWAYS, SW_FAULT, FIRST},
};
/* clang-format on */

#define LAST ((int)(sizeof transitions / sizeof transitions[0]) - 1)

static uint8_t missing(const period *now)
{
    return now->inputs->usable ? (uint8_t)SW_REASON_NONE : now->inputs->unusable_because;
}

/* Returns `reason`, or NOT_AUTHENTIC if the vehicle's request is ignored because no frame is authentic. */
static uint8_t unless_refused(const period *now, uint8_t reason)
{
    return missing(now) == SW_REASON_NOT_AUTHENTIC ? (uint8_t)SW_REASON_NOT_AUTHENTIC : reason;
}

static uint8_t waiting(const period *now)
{
    const uint8_t in_a_test = (uint8_t)(now->inputs->tests ? SW_REASON_NOT_HELPING : SW_REASON_NONE);
    const uint8_t usable = (uint8_t)(now->inputs->off_speed ? SW_REASON_OFF_SPEED : in_a_test);
    return now->inputs->usable ? usable : missing(now);
}

static int is_filling(const period *now)
{
    return now->inputs->off_speed || now->inputs->tests || !now->inputs->window_full;
}

static int rearmed(const period *now) { return now->inputs->usable && now->rises && now->good >= SW_REARM_FRAMES; }

static int holds(uint8_t when, const period *now)
{
    const int usable = now->inputs->usable;
    int result = 1;
    switch (when) {
    case UPDATING:
        result = now->inputs->updating;
        break;
    case OWN_FAULT:
        result = now->inputs->fault != SW_REASON_NONE;
        break;
    case REARMED:
        result = rearmed(now);
        break;
    case REARMED_FILLING:
        result = rearmed(now) && is_filling(now);
        break;
    case LOW:
        result = !now->request;
        break;
    case NEVER_YET:
        result = !usable && !now->rises;
        break;
    case LOW_AND_USABLE:
        result = usable && !now->request;
        break;
    case STANDING:
        result = usable && !now->rises;
        break;
    case INVALID:
        result = missing(now) == SW_REASON_STREAM_INVALID;
        break;
    case TOO_LONG:
        result = now->misses > SW_HOLD_PERIODS + SW_DECAY_PERIODS;
        break;
    case TOO_MANY:
        result = !usable && now->lost >= SW_LOSS_LIMIT;
        break;
    case FILLING:
        result = is_filling(now);
        break;
    case USABLE:
        result = usable;
        break;
    case SHORT:
        result = now->misses <= SW_HOLD_PERIODS;
        break;
    default:
        break; /* condition ALWAYS */
    }
    return result;
}

static uint8_t reason_of(uint8_t because_of, const period *now)
{
    uint8_t reason = SW_REASON_NONE;
    switch (because_of) {
    case QUIET:
        reason = unless_refused(now, SW_REASON_NONE);
        break;
    case WRITING:
        reason = SW_REASON_UPDATING;
        break;
    case STANDS:
        reason = unless_refused(now, SW_REASON_NOT_ARMED);
        break;
    case MISSING:
        reason = missing(now);
        break;
    case WAITING:
        reason = waiting(now);
        break;
    case OWN:
        reason = now->inputs->fault;
        break;
    case FIRST:
        reason = now->kept;
        break;
    default:
        break; /* NO_REASON */
    }
    return reason;
}

/* Returns the row for a period. A row always exists, since each mode has a row whose condition is always true. */
static const transition *taken(uint8_t mode, const period *now)
{
    for (int row = 0; row < LAST; row++) {
        if ((transitions[row].start & IN(mode)) != 0u && holds(transitions[row].when, now)) return &transitions[row];
    }
    return &transitions[LAST];
}

/* Returns one bit for each of the latest periods with a request for control, including this period: 1 means lost. */
static uint64_t lost_with(const sw_fail_safe *before, const period *now)
{
    const unsigned counts_no_loss = FAULT | UPDATE;
    const unsigned unwanted = INIT | STANDBY | ARMED;
    const uint64_t judged = UINT64_MAX >> (64 - SW_LOSS_WINDOW);
    const uint64_t newest = now->inputs->usable ? 0u : 1u;
    const int counted = now->request && now->inputs->fault == SW_REASON_NONE &&
                        (IN(before->mode) & counts_no_loss) == 0u &&
                        (now->rises || (IN(before->mode) & unwanted) == 0u);
    return counted ? ((before->lost << 1) | newest) & judged : 0u;
}

void sw_fail_safe_start(sw_fail_safe *fail_safe)
{
    fail_safe->mode = SW_INIT;
    fail_safe->reason = SW_REASON_NONE;
    fail_safe->enable_request = 1;
    fail_safe->misses = 0;
    fail_safe->good = 0;
    fail_safe->lost = 0;
}

void sw_fail_safe_next(sw_fail_safe *fail_safe, const sw_period_inputs *inputs)
{
    period now = {inputs, 0, 0, fail_safe->reason, 0, 0, 0};
    now.request = inputs->has_request ? inputs->enable_request : fail_safe->enable_request;
    now.rises = now.request && !fail_safe->enable_request;
    if (inputs->usable) {
        /* A fault of the ECU itself restarts the count of good frames for re-arming, with this period's frame. */
        now.good = inputs->fault == SW_REASON_NONE ? sw_counted(fail_safe->good, 1) : 1u;
    } else {
        now.misses = sw_counted(fail_safe->misses, 1);
    }
    const uint64_t lost = lost_with(fail_safe, &now);
    now.lost = sw_bit_count(lost);
    const transition *row = taken(fail_safe->mode, &now);
    if (row->to == SW_FAULT && fail_safe->mode != SW_FAULT) {
        /* As after power-on, the request must first be low, so that a rise that was missed does not end the fault. */
        now.request = !inputs->has_request || inputs->enable_request;
    }
    fail_safe->mode = row->to;
    fail_safe->reason = reason_of(row->reason, &now);
    fail_safe->enable_request = now.request;
    fail_safe->misses = now.misses;
    fail_safe->good = now.good;
    fail_safe->lost = lost;
}

void sw_fail_safe_latch(sw_fail_safe *fail_safe, uint8_t reason)
{
    const sw_period_inputs inputs = {0, 0, 0, reason, 0, 0, 0, reason, 0};
    const period now = {&inputs, fail_safe->enable_request, 0, fail_safe->reason, fail_safe->misses, 0, 0};
    const transition *row = taken(fail_safe->mode, &now);
    fail_safe->mode = row->to;
    fail_safe->reason = reason_of(row->reason, &now);
    fail_safe->good = 0;
    fail_safe->lost = 0;
}

int sw_drives_jets(uint8_t mode) { return mode == SW_CONTROL || mode == SW_HOLD || mode == SW_DECAY; }

uint8_t sw_mode_on_wire(uint8_t mode)
{
    static const uint8_t on_wire[] = {
        [SW_INIT] = SW_MODE_OFF,      [SW_STANDBY] = SW_MODE_OFF,    [SW_ARMED] = SW_MODE_OFF,
        [SW_WARMUP] = SW_MODE_WARMUP, [SW_CONTROL] = SW_MODE_CONTROL, [SW_HOLD] = SW_MODE_HOLD,
        [SW_DECAY] = SW_MODE_DECAY,   [SW_FAULT] = SW_MODE_FAULT,    [SW_UPDATE] = SW_MODE_OFF,
    };
    return on_wire[mode];
}
