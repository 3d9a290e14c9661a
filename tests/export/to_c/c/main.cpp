#include "stillwake.h"
#include "sw_prior.h"
#include "sw_weights.h"
#include <cstdio>

static sw_workspace work;
static sw_input in;
static sw_output out;

int main()
{
    sw_input_reset(&in);
    float pressures[SW_SENSORS] = {};
    for (int k = 0; k < SW_WINDOW; k++) sw_input_push(&in, pressures, 0.0f);
    if (sw_workspace_bytes() != sizeof(work)) return 2;
    if (sw_control_step(&work, &in, &out) != SW_OK) return 3;
    std::printf("%g\n", static_cast<double>(out.plan[0]));
    return 0;
}
