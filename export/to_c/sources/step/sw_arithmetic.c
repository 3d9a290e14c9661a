/* The check of float arithmetic with a known answer, compiled with the flags of the control step. */
#include "sw_arithmetic.h"

#include "stillwake.h"

sw_status sw_arithmetic(void) { return sw_float_wrong() == 0u ? SW_OK : SW_WRONG_ARITHMETIC; }
