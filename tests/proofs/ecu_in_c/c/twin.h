/* Control periods as they were lived through by the Python ECU, and a way to live through them again. */
#ifndef TWIN_H
#define TWIN_H

#include "sw_ecu.h"

#define TWIN_FRAMES 10

/* What the networks answer in a period, whatever they are asked. */
typedef struct {
    uint8_t is_planned; /* the control step is SW_OK */
    float plan[SW_HORIZON];
    float forces[SW_HORIZON][2];
    double estimates[SW_HYPOTHESES][SW_SENSORS];
} twin_answers;

typedef struct {
    int64_t now_ns;
    uint8_t restarts; /* power-on before it; the state is then `before` */
    uint8_t loads;    /* it starts from `before`, whatever was */
    uint8_t calibrates;
    sw_calibration calibration; /* before the step */
    sw_surroundings surroundings;
    int32_t count;
    sw_frame not_first; /* none that came, but looks like it; so does the one behind the last */
    sw_frame frames[TWIN_FRAMES + 1];
    twin_answers answers;
    sw_ecu_state before;
} twin_stimulus;

/* All bytes that no field names are zero; so is the input of a network that was not asked. */
typedef struct {
    uint8_t starts_otherwise; /* than `before`, at power-on */
    int32_t refused; /* of the calibration: the number of the first value that is out of its limits */
    sw_calibration calibration;
    int32_t sent;
    sw_frame frames[SW_FRAMES_OUT];
    sw_trace trace;
    sw_ecu_state state;
    uint32_t plans_asked;
    uint32_t estimates_asked;
    sw_input planned_on;
    double estimated_on[SW_WINDOW][SW_COLUMNS];
} twin_response;

typedef struct {
    twin_stimulus stimulus;
    twin_response response;
} twin_period;

/* One period by the ECU in C. */
void twin_step(sw_ecu *ecu, const twin_stimulus *stimulus, twin_response *response);

/* All of them. Returns the first whose response differs in a byte that `compared` marks, or `count`; `found` then has
 * that response.
 */
int twin_run(sw_ecu *ecu, const twin_period *periods, int count, const uint8_t *compared, twin_response *found);

#endif
