/* The replay of recorded rows through the controller on a host: an example of the calls, and a program for debuggers
 * and sanitisers. All other C files of the folder are part of the library.
 *
 *     cc -std=c99 -O3 *.c -o replay && ./replay < recorded.txt
 *     ./replay recorded.txt expected.txt
 *
 * A row has the pressures Cp at the sensors and the action of the step before. From the first full window on, each row
 * has an answer of four numbers: the planned action, the predicted mean Cd and Cl, and the cost.
 *
 * With one file, the program prints each answer and uses its plan in the next step, as on a vehicle. With two files,
 * each answer starts from a plan of zeros and is compared with a line of the second file. The program ends with exit
 * status 1 at the first answer that differs by more than different compilers cause.
 */
#include <stdio.h>

#include "stillwake.h"
#include "sw_weights.h"

static sw_workspace workspace;
static sw_input input;
static sw_output output;

/* Compilers order operations differently, so results are rounded differently. A gradient near zero may then change its
 * sign, so that a step of Adam goes in the opposite direction. The size of a step is the learning rate, 1e-3. The
 * effect of such steps on the forces depends on the plant, so forces are compared in units of their standard deviation
 * in training. No compared answer starts from an earlier plan, because a sequence of steps can amplify differences.
 */
static const double tolerance = 5e-3, force_tolerance = 3e-2;

static const char *const names[4] = {"action", "mean Cd", "mean Cl", "cost"};

static int read_row(FILE *rows, float pressures[SW_SENSORS], float *previous_action)
{
    for (int s = 0; s < SW_SENSORS; s++) {
        if (fscanf(rows, "%f", &pressures[s]) != 1) return 0;
    }
    return fscanf(rows, "%f", previous_action) == 1;
}

/* Returns whether the next line of the file has these four numbers. */
static int is_expected(FILE *expected, const double answer[4], int row)
{
    for (int i = 0; i < 4; i++) {
        const double allowed = i == 1 || i == 2 ? force_tolerance * (double)sw_own_weights.force_std[i - 1] : tolerance;
        double number;
        if (fscanf(expected, "%lf", &number) != 1) {
            fprintf(stderr, "row %d: no answer is expected\n", row);
            return 0;
        }
        if (!(answer[i] - number <= allowed && number - answer[i] <= allowed)) {
            fprintf(stderr, "row %d, %s: %.9g, expected %.9g within %.2g\n", row, names[i], answer[i], number, allowed);
            return 0;
        }
    }
    return 1;
}

int main(int argc, char **argv)
{
    float pressures[SW_SENSORS], previous_action;
    FILE *rows = argc > 1 ? fopen(argv[1], "r") : stdin;
    FILE *expected = argc > 2 ? fopen(argv[2], "r") : NULL;
    int answers = 0;
    if (rows == NULL || (argc > 2 && expected == NULL)) {
        fprintf(stderr, "usage: replay [rows [expected answers]]: a file cannot be read\n");
        return 1;
    }
    if (sw_input_reset(&input) != SW_OK) {
        fprintf(stderr, "this build computes otherwise than IEEE 754: compile without -ffast-math and its parts\n");
        return 1;
    }
    for (int row = 1; read_row(rows, pressures, &previous_action); row++) {
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
            input.plan[k] = expected == NULL ? output.plan[k] : 0.0f;
        }
        const double answer[4] = {(double)output.plan[0], (double)drag, (double)lift, (double)output.cost};
        if (expected != NULL && !is_expected(expected, answer, row)) return 1;
        if (expected == NULL) printf("%.9g %.9g %.9g %.9g\n", answer[0], answer[1], answer[2], answer[3]);
        answers++;
    }
    if (answers == 0) {
        fprintf(stderr, "fewer rows than a window has\n");
        return 1;
    }
    if (expected != NULL) printf("%d answers, all as expected\n", answers);
    return 0;
}
