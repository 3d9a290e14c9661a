/* Replays recorded rows through the controller on a host: an example of the calls, and a program for debuggers and
 * sanitisers. It is the only file here that is not part of the library.
 *
 *     cc -std=c99 -O3 *.c -o replay && ./replay < recorded.txt
 *
 * A row is the pressures Cp at the sensors and the action that was commanded one step before. From the first full window
 * on, each row is answered by a line: the planned action, the predicted mean Cd and Cl, and the cost.
 */
#include <stdio.h>

#include "stillwake.h"

static sw_workspace workspace;
static sw_input input;
static sw_output output;

static int read_row(float pressures[SW_SENSORS], float *previous_action)
{
    for (int s = 0; s < SW_SENSORS; s++) {
        if (scanf("%f", &pressures[s]) != 1) return 0;
    }
    return scanf("%f", previous_action) == 1;
}

int main(void)
{
    float pressures[SW_SENSORS], previous_action;
    sw_input_reset(&input);
    for (int row = 1; read_row(pressures, &previous_action); row++) {
        float drag = 0.0f, lift = 0.0f;
        sw_input_push(&input, pressures, previous_action);
        if (row < SW_WINDOW) continue;
        if (sw_control_step(&workspace, &input, &output) != SW_OK) {
            fprintf(stderr, "row %d: a number is not finite\n", row);
            return 1;
        }
        for (int k = 0; k < SW_HORIZON; k++) {
            drag += output.forces[k][0] / (float)SW_HORIZON;
            lift += output.forces[k][1] / (float)SW_HORIZON;
            input.plan[k] = output.plan[k];
        }
        printf("%.9g %.9g %.9g %.9g\n", (double)output.plan[0], (double)drag, (double)lift, (double)output.cost);
    }
    return 0;
}
