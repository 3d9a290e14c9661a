/* The rows of past control periods, resampled for the present speed: at equal distances travelled. This file
 * corresponds to contract/controller/resampling.py, and to Past in ecu/controller_memory.py. Both give the reasons.
 */
#include "sw_ecu_parts.h"

double sw_followed(double before, double to, double share)
{
    return share >= 1.0 ? to : before + share * (to - before);
}

#if SW_PAST > 0

void sw_past_empty(sw_past *past)
{
    for (int k = 0; k < SW_PAST; k++) {
        for (int c = 0; c < SW_COLUMNS; c++) past->rows[k][c] = 0.0;
        past->speeds[k] = 0.0;
    }
    past->count = 0;
}

void sw_past_extend(sw_past *past, const double row[SW_COLUMNS], double speed)
{
    for (int k = 0; k + 1 < SW_PAST; k++) {
        for (int c = 0; c < SW_COLUMNS; c++) past->rows[k][c] = past->rows[k + 1][c];
        past->speeds[k] = past->speeds[k + 1];
    }
    /* `newest` still has the previous period's pressures, which the filter needs. */
    double *newest = past->rows[SW_PAST - 1];
    for (int s = 0; s < SW_SENSORS; s++) newest[s] = past->count > 0u ? sw_followed(newest[s], row[s], speed) : row[s];
    newest[SW_SENSORS] = row[SW_SENSORS];
    past->speeds[SW_PAST - 1] = speed;
    if (past->count < SW_PAST) past->count++;
}

uint32_t sw_past_read(const sw_past *past, double window[SW_WINDOW][SW_COLUMNS], int first, int last)
{
    const int oldest = SW_PAST - (int)past->count;
    int at = SW_PAST - 1; /* index of the oldest stored row that is not older than row k of the window */
    double age = 0.0;     /* distance travelled since the stored row, in steps */
    double steps = 0.0;
    uint32_t rows = 0;
    for (int k = SW_WINDOW - 1; k >= 0; k--) {
        while (at > oldest && age + past->speeds[at] <= steps) {
            age += past->speeds[at];
            at--;
        }
        /* Whether the stored rows go back as far as row k of the window. */
        const int is_there = at > oldest || (at == oldest && age >= steps);
        const double share = is_there ? (steps - age) / past->speeds[at] : 0.0;
        const int older = share > 0.0 ? at - 1 : at;
        for (int c = first; c <= last; c++) {
            const double newer = past->rows[at][c];
            window[k][c] = is_there ? newer + share * (past->rows[older][c] - newer) : 0.0;
        }
        if (is_there) rows++;
        steps += 1.0;
    }
    return rows;
}

#endif
