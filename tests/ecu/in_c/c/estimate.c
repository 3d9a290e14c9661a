#include "sw_ecu_parts.h"
void estimate(const double window[SW_WINDOW][SW_COLUMNS], int first, double found[SW_HYPOTHESES][SW_SENSORS]);
void estimate(const double window[SW_WINDOW][SW_COLUMNS], int first, double found[SW_HYPOTHESES][SW_SENSORS])
{
    static sw_estimator_work work;
    sw_estimate(&work, &sw_own_estimator, window, first);
    for (int h = 0; h < SW_HYPOTHESES; h++) {
        for (int s = 0; s < SW_SENSORS; s++) found[h][s] = work.estimates[h][s];
    }
}
