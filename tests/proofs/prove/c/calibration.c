/* What a tester may change: any values, numbers that are none among them. */
#include "prove.h"

#include "sw_calibration.c"

void any_values(void)
{
    sw_calibration values;
    sw_release release;
    const int beyond = sw_calibration_beyond(&values, &release);
    PROVE(beyond >= 0 && beyond <= SW_TERMS + 3);
    if (beyond != 0) return;
    PROVE(values.action_limit <= greatest.action_limit && values.action_limit > 0.0f);
    PROVE(values.delay_steps <= greatest.delay_steps);
    PROVE((int)values.delay_steps + SW_PLAN_AHEAD < SW_HORIZON);
    for (int i = 0; i < SW_TERMS; i++) PROVE(values.weights[i] >= 0.0f);
    const sw_gate_limits limits = sw_calibration_limits(&values);
    PROVE(limits.flow_m2_per_s >= 0.0 && limits.flow_m2_per_s <= SW_GATE_FLOW);
    PROVE(limits.step_m2_per_s >= 0.0 && limits.step_m2_per_s <= SW_GATE_STEP);
}

void own_values(void)
{
    sw_calibration own;
    sw_release release;
    for (int i = 0; i < SW_TERMS; i++) ASSUME(release.weights[i] >= 0.0f); /* the export's gate, and the signature */
    sw_calibration_own(&release, &own);
    PROVE(sw_calibration_beyond(&own, &release) == 0);
}
