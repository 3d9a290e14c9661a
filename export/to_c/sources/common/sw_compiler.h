/* This header rejects compiler flags that make control wrong by changing the arithmetic, if a predefined macro shows
 * the flag. A known answer detects the other flags (sw_arithmetic.h). GCC and Clang each predefine some of the macros.
 */
#ifndef SW_COMPILER_H
#define SW_COMPILER_H

#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(_M_FP_FAST)
#error "sums keep their order and divisions are divisions here: compile without -ffast-math and its parts"
#endif
#if defined(__NO_SIGNED_ZEROS__)
#error "a zero has a sign here: compile without -fno-signed-zeros"
#endif
#if defined(__FINITE_MATH_ONLY__)
#if __FINITE_MATH_ONLY__ > 0
#error "numbers that are none must be found: compile without -ffinite-math-only"
#endif
#endif
#if defined(__FLT_EVAL_METHOD__)
#if __FLT_EVAL_METHOD__ != 0 && __FLT_EVAL_METHOD__ != 16
#error "FLT_EVAL_METHOD must be 0 or 16, every operation in its own type; on x86 compile with -msse2 -mfpmath=sse"
#endif
#endif

/* These macros unroll the following loop on a Cortex-M, so that compilers interleave the passes of the loop. The core
 * issues two instructions at a time, but only in order.
 */
#if defined(__ARM_FEATURE_DSP) && defined(__thumb2__) && defined(__clang__)
#define SW_FOUR_TIMES _Pragma("clang loop unroll_count(4)")
#define SW_EIGHT_TIMES _Pragma("clang loop unroll_count(8)")
#elif defined(__ARM_FEATURE_DSP) && defined(__thumb2__) && defined(__GNUC__)
#define SW_FOUR_TIMES _Pragma("GCC unroll 4")
#define SW_EIGHT_TIMES _Pragma("GCC unroll 8")
#else
#define SW_FOUR_TIMES
#define SW_EIGHT_TIMES
#endif

/* Loads four numbers before the following statements, as a Cortex-M cannot use a number in the cycle after its load. */
#if defined(__ARM_FEATURE_DSP) && defined(__thumb2__) && defined(__GNUC__)
#define SW_LOADED(a, b, c, d) __asm__("" : "+t"(a), "+t"(b), "+t"(c), "+t"(d))
#else
#define SW_LOADED(a, b, c, d) (void)0
#endif

typedef char sw_compile_without_fsingle_precision_constant[sizeof(1.0) == sizeof(double) ? 1 : -1];

#endif
