/* Decisions must be those of the Python ECU to the bit: no multiplication may be fused with an addition. GCC knows no such
 * line; compile the ECU with -ffp-contract=off there. Arithmetic that cannot be right is refused in sw_compiler.h.
 */
#ifndef SW_EXACT_H
#define SW_EXACT_H

#include "sw_compiler.h"

#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

#if defined(__DBL_MANT_DIG__)
#if __DBL_MANT_DIG__ != 53
#error "double: must have 64 bits; some compilers for microcontrollers need an option for it"
#endif
#endif

#endif
