/* What the known answers are in each mode of an x86 processor: sw_arithmetic's and the ECU's, a line a mode. */
#include <stdio.h>
#include <xmmintrin.h>

#include "sw_ecu_parts.h"

int main(void)
{
    /* Plain; rounding down, up, towards zero; small results as zero; small inputs as zero; plain again. */
    const unsigned modes[] = {0u, 0x2000u, 0x4000u, 0x6000u, 0x8000u, 0x40u, 0u};
    for (unsigned i = 0; i < sizeof modes / sizeof modes[0]; i++) {
        _mm_setcsr(0x1f80u | modes[i]);
        printf("%d %d\n", (int)sw_arithmetic(), (int)sw_inexact());
    }
    return 0;
}
