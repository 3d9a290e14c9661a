/* The pragma in this header forbids the compiler to fuse a multiplication with an addition. This ECU and the Python ECU
 * therefore give equal results, bit for bit. GCC ignores the pragma: compile the ECU with -ffp-contract=off.
 * sw_compiler.h rejects unsuitable arithmetic.
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
