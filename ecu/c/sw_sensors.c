/* The sensor check. It judges whether the pressures are plausible. This file corresponds to ecu/sensor_check.py, which
 * explains the criteria. Sums are computed from left to right, as in NumPy for so few numbers.
 */
#include "sw_counts.h"
#include "sw_ecu_parts.h"

void sw_sensors_start(sw_sensors *sensors)
{
    sensors->set_aside = -1;
    sensors->implausible = 0;
    sensors->judged = 0;
    sensors->has_read = 0;
    sensors->doubt = 0;
    for (int s = 0; s < SW_SENSORS; s++) {
        sensors->flat[s] = 0;
        sensors->readings[s] = 0.0;
        for (int h = 0; h < SW_HYPOTHESES; h++) {
            sensors->residual[h][s] = 0.0;
            sensors->fast[h][s] = 0.0;
            sensors->slow[h][s] = 0.0;
            sensors->noise[h][s] = 0.0;
            sensors->score[h][s] = 0.0;
        }
        for (int k = 0; k < SW_KEPT; k++) sensors->estimates[k][s] = 0.0;
    }
}

#if SW_SENSOR_CHECK

#if SW_SENSORS != 4
#error "sw_sensors.c: the median of the other sensors' movements is that of three"
#endif
#if SW_FLAT_PERIODS > SW_WINDOW
#define FLAT_ROWS SW_WINDOW
#else
#define FLAT_ROWS SW_FLAT_PERIODS
#endif

/* Evidence for errors of the sensors, relative to the values of healthy sensors. */
typedef struct {
    double liar[SW_SENSORS]; /* evidence that only this sensor reads wrongly */
    double bias[SW_SENSORS]; /* like `liar`, from the slow means */
    double swap;             /* evidence that two sensors are exchanged: the largest value of all pairs */
    double doubt;            /* evidence that the sensors in use contradict each other */
    double drift;            /* like `doubt`, from the slow means of all sensors but the excluded or the worst sensor */
} levels;

static double square(double value) { return value * value; }
static double larger(double a, double b) { return a > b ? a : b; }
static double smaller(double a, double b) { return a < b ? a : b; }

/* Returns the running mean after one more value. */
static double mean_with(double before, double value, int periods)
{
    return before + (value - before) / (double)periods;
}

static double mean_of(const double values[SW_SENSORS])
{
    return (((values[0] + values[1]) + values[2]) + values[3]) / (double)SW_SENSORS;
}

/* Returns the mean of the values of the other sensors. */
static double others_mean(const double values[SW_SENSORS], int own)
{
    const double sum = ((values[0] + values[1]) + values[2]) + values[3];
    return (sum - values[own]) / (double)(SW_SENSORS - 1);
}

/* Returns the row of deviations for a hypothesis; for an exchanged pair, the row in which the sensor is left out. */
static int row_of(int hypothesis, int sensor) { return hypothesis < SW_SENSORS ? hypothesis : sensor; }

/* Appends copies of the newest row of estimates: one for this period, and one for each skipped period. */
static void prolong(sw_sensors *sensors, int64_t skipped)
{
    const int rows = skipped < SW_KEPT ? (int)skipped + 1 : SW_KEPT;
    for (int k = 0; k < SW_KEPT; k++) {
        const int from = k + rows < SW_KEPT ? k + rows : SW_KEPT - 1;
        for (int s = 0; s < SW_SENSORS; s++) sensors->estimates[k][s] = sensors->estimates[from][s];
    }
}

/* Counts the consecutive periods in which each reading did not change. */
static void count_flat(sw_sensors *sensors, const double *reading)
{
    for (int s = 0; s < SW_SENSORS; s++) {
        const int same = sensors->has_read && reading[s] == sensors->readings[s];
        sensors->flat[s] = same ? sw_counted(sensors->flat[s], 1) : 0;
        sensors->readings[s] = reading[s];
    }
    sensors->has_read = 1;
}

/* Updates the running means of a hypothesis with one more residual of each sensor. */
static void average(sw_sensors *sensors, const sw_release *release, int h, const double readings[SW_SENSORS],
                    const double estimates[SW_SENSORS])
{
    for (int s = 0; s < SW_SENSORS; s++) {
        const double residual = readings[s] - estimates[s];
        const double change = sensors->judged ? residual - sensors->residual[h][s] : 0.0;
        const double fast = mean_with(sensors->fast[h][s], residual, SW_FAST_PERIODS);
        const double noise = mean_with(sensors->noise[h][s], square(change) / 2.0, SW_SCORE_PERIODS);
        const double sound = release->fast_deviation[row_of(h, s)][s];
        const double score = square(fast) / (square(sound) + SW_NOISE_ALLOWED * noise);
        sensors->residual[h][s] = residual;
        sensors->fast[h][s] = fast;
        sensors->slow[h][s] = mean_with(sensors->slow[h][s], residual, SW_SLOW_PERIODS);
        sensors->noise[h][s] = noise;
        sensors->score[h][s] = mean_with(sensors->score[h][s], score, SW_SCORE_PERIODS);
    }
}

/* Updates the running means of all hypotheses: each sensor may read wrongly, and each pair may be exchanged. For an
 * exchanged pair, each reading is compared with the other sensor's estimate.
 */
static void average_all(sw_sensors *sensors, const sw_release *release, const double cp[SW_SENSORS],
                        const sw_estimator_work *work)
{
    int pair = SW_SENSORS;
    for (int i = 0; i < SW_SENSORS; i++) {
        average(sensors, release, i, cp, work->estimates[i]);
        for (int j = i + 1; j < SW_SENSORS; j++) {
            double crossed[SW_SENSORS];
            for (int s = 0; s < SW_SENSORS; s++) crossed[s] = cp[s];
            crossed[i] = cp[j];
            crossed[j] = cp[i];
            average(sensors, release, pair, crossed, work->estimates[pair]);
            pair++;
        }
    }
    sensors->judged = 1;
}

/* Returns a sensor's value / (1 + mean of the other sensors' values). */
static double alone_in(const double values[SW_SENSORS], int own)
{
    return values[own] / (1.0 + others_mean(values, own));
}

/* Computes the evidence from the running means. */
static levels levels_of(const sw_sensors *sensors, const sw_release *release)
{
    levels found = {{0.0}, {0.0}, 0.0, 0.0, 0.0};
    double alone[SW_SENSORS], without[SW_SENSORS];
    for (int j = 0; j < SW_SENSORS; j++) {
        double slow[SW_SENSORS];
        for (int i = 0; i < SW_SENSORS; i++) {
            const double noise = sensors->noise[j][i] / (double)(2 * SW_SLOW_PERIODS - 1);
            const double sound = square(release->slow_deviation[j][i]) + noise;
            slow[i] = square(sensors->slow[j][i]) / sound;
        }
        alone[j] = sensors->score[j][j];
        found.liar[j] = alone_in(sensors->score[j], j);
        found.bias[j] = alone_in(slow, j);
        without[j] = others_mean(slow, j);
    }
    const double disagreement = mean_of(alone);
    for (int p = SW_SENSORS; p < SW_HYPOTHESES; p++) {
        const double swap = disagreement / (1.0 + mean_of(sensors->score[p]));
        if (swap > found.swap) found.swap = swap;
    }
    const int aside = sensors->set_aside;
    if (aside < 0) {
        found.doubt = disagreement;
        found.drift = smaller(smaller(without[0], without[1]), smaller(without[2], without[3]));
    } else {
        found.doubt = others_mean(sensors->score[aside], aside) / SW_ASIDE_ALLOWED;
        found.drift = without[aside];
    }
    found.drift /= SW_DRIFT_ALLOWED;
    return found;
}

/* Returns the difference between the largest and the smallest value in a column of the window from row `first` on. */
static double moved(const double window[SW_WINDOW][SW_COLUMNS], int first, int column)
{
    double least = window[first][column], most = least;
    for (int k = first + 1; k < SW_WINDOW; k++) {
        const double value = window[k][column];
        if (value < least) least = value;
        if (value > most) most = value;
    }
    return most - least;
}

/* Returns the mean deviation of healthy sensors' residuals; each sensor is estimated from all other sensors. */
static double sound_deviation(const sw_release *release)
{
    double sound[SW_SENSORS];
    for (int s = 0; s < SW_SENSORS; s++) sound[s] = release->fast_deviation[s][s];
    return mean_of(sound);
}

/* Returns whether there was a flow while the sensor `resting` was stuck. If there was a flow, the median range of the
 * other sensors' pressures is large. Rows before row `first` count as equal to row `first`.
 */
static int others_move(const sw_release *release, int resting, const double window[SW_WINDOW][SW_COLUMNS], int first)
{
    const int begin = first > SW_WINDOW - FLAT_ROWS ? first : SW_WINDOW - FLAT_ROWS;
    double by[SW_SENSORS - 1];
    for (int s = 0, n = 0; s < SW_SENSORS; s++) {
        if (s != resting) by[n++] = moved(window, begin, s);
    }
    const double median = larger(smaller(by[0], by[1]), smaller(larger(by[0], by[1]), by[2]));
    return median >= SW_MOVING * sound_deviation(release);
}

/* Returns whether two sensors in use have nearly equal, changing readings over a whole window. */
static int any_alike(const sw_release *release, const double window[SW_WINDOW][SW_COLUMNS], int set_aside)
{
    const double sound = sound_deviation(release);
    const double most = (double)SW_WINDOW * square(SW_ALIKE * sound);
    int alike = 0;
    for (int i = 0; i < SW_SENSORS; i++) {
        for (int j = i + 1; j < SW_SENSORS; j++) {
            const int in_use = i != set_aside && j != set_aside;
            double sum = in_use ? 0.0 : 2.0 * most + 1.0;
            for (int k = 0; k < SW_WINDOW; k++) {
                if (sum > most) break; /* the sum can only grow */
                sum += square(window[k][i] - window[k][j]);
            }
            if (sum <= most && moved(window, 0, i) >= SW_COPIED * sound) alike = 1;
        }
    }
    return alike;
}

/* Returns the first sensor with the most evidence, or -1 if no sensor has enough evidence. */
static int liar_of(const levels *found)
{
    int liar = -1;
    double most = 1.0;
    for (int j = 0; j < SW_SENSORS; j++) {
        const double evidence = larger(found->liar[j] / SW_LIAR_LEVEL, found->bias[j] / SW_BIAS_LEVEL);
        if (liar < 0 ? evidence >= most : evidence > most) {
            liar = j;
            most = evidence;
        }
    }
    return liar;
}

/* Returns the new count of doubt: one more after a period with doubt, one less after any other period. */
static uint32_t counted_doubt(uint32_t doubt, int doubted)
{
    uint32_t next = doubt;
    if (doubted) {
        if (next < SW_DOUBT_PERIODS) next++;
    } else if (next > 0) {
        next--;
    } else {
        /* The count does not fall below 0. */
    }
    return next;
}

/* Judges the sensors from the running means and the stuck readings. */
static void judge(sw_sensors *sensors, const sw_release *release, const double window[SW_WINDOW][SW_COLUMNS], int first)
{
    const levels found = levels_of(sensors, release);
    int set_aside = sensors->set_aside, resting = 0, which = 0;
    for (int j = SW_SENSORS - 1; j >= 0; j--) {
        if (sensors->flat[j] >= SW_FLAT_PERIODS && j != set_aside) {
            resting++;
            which = j;
        }
    }
    const int newly_from_rest = set_aside < 0 && resting == 1 && others_move(release, which, window, first);
    if (newly_from_rest) {
        set_aside = which;
        resting = 0;
    } else if (set_aside < 0) {
        set_aside = liar_of(&found);
    } else {
        /* The sensor stays excluded. */
    }
    const int swapped = set_aside < 0 && found.swap >= SW_SWAP_LEVEL;
    if (resting > 0 || (first == 0 && any_alike(release, window, set_aside))) {
        sensors->doubt = SW_DOUBT_PERIODS;
    } else if (set_aside != sensors->set_aside) {
        sensors->doubt = 0;
    } else {
        const int doubted = larger(found.doubt, found.drift) >= SW_DOUBT_LEVEL;
        sensors->doubt = counted_doubt(sensors->doubt, doubted || swapped);
    }
    sensors->set_aside = (int8_t)set_aside;
    sensors->implausible =
        (uint8_t)(sensors->doubt >= SW_DOUBT_PERIODS || (sensors->implausible && sensors->doubt > 0));
}

uint8_t sw_sensors_next(sw_sensors *sensors, const sw_numbers *numbers, sw_estimator_work *work, const sw_memory *memory,
                        const double *cp, const double *reading, int64_t skipped)
{
    const sw_release *release = numbers->release;
    prolong(sensors, skipped);
    if (cp != NULL && memory->rows > 0) {
        const int first = SW_WINDOW - (int)memory->rows;
        sw_estimate(work, numbers->estimator, memory->window, first);
        for (int s = 0; s < SW_SENSORS; s++) sensors->estimates[SW_KEPT - 1][s] = work->estimates[s][s];
        count_flat(sensors, reading);
        if (first == 0) average_all(sensors, release, cp, work);
        judge(sensors, release, memory->window, first);
    }
    return (uint8_t)(sensors->implausible ? SW_REASON_IMPLAUSIBLE : SW_REASON_NONE);
}

#endif
