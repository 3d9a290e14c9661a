/* The known answer of the control step's files. */
#include "sw_arithmetic.h"

#include "stillwake.h"

sw_status sw_arithmetic(void) { return sw_float_wrong() == 0u ? SW_OK : SW_WRONG_ARITHMETIC; }

sw_status sw_refused(sw_output *output)
{
    for (int k = 0; k < SW_HORIZON; k++) {
        output->plan[k] = 0.0f;
        output->forces[k][0] = 0.0f;
        output->forces[k][1] = 0.0f;
    }
    for (int i = 0; i < SW_TERMS; i++) output->terms[i] = 0.0f;
    output->cost = 0.0f;
    return SW_WRONG_ARITHMETIC;
}
