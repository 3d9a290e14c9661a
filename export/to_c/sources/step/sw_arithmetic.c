/* The known answer of the control step's files. */
#include "sw_arithmetic.h"

#include "stillwake.h"

sw_status sw_arithmetic(void) { return sw_float_wrong() == 0u ? SW_OK : SW_WRONG_ARITHMETIC; }
