/* The loops of sw_norm.h's forward pass for cores with the Arm DSP extension, two outputs at a time.
 *
 * The loops are in assembly, and their instructions are ordered for cores that issue two instructions at a time, as in
 * sw_dots_dsp.h. The results equal the results of sw_norm_plain.h bit for bit. Each loop needs thirteen registers; its
 * end address is on the stack.
 */
#ifndef SW_NORM_DSP_H
#define SW_NORM_DSP_H

#include "sw_weights.h"

#if SW_ELU_STEP != 8192 || SW_ELU_START != 2097152 || SW_ELU_ONE != 4096 || SW_SLOPE_SHIFT != 4
#error "the table's step and range stand in these instructions"
#endif

/* Instructions on one line belong to one operation. */
/* clang-format off */

/* Computes u = sum * scale + bias of the outputs at `at`, and the sums of u and u^2; loads the data at `next`. */
#define SW_TWO_SUMS(at, second, next)                                                                       \
    "smmlar %[r], %[a], %[m], %[x]\n"                                                                       \
    "smmlar %[q], %[b], %[n], %[y]\n"     next                                                              \
    "str %[r], [%[s], #" at "]\n"         "add %[sum], %[r]\n"                                              \
    "str %[q], [%[s], #" second "]\n"     "add %[sum], %[q]\n"

#define SW_SUMS_AT(at, of_bias)                                                                             \
    "ldrd %[a], %[b], [%[s], #" at "]\n"  "smlal %[low], %[high], %[r], %[r]\n"                             \
    "ldrd %[m], %[n], [%[of], #" at "]\n" "smlal %[low], %[high], %[q], %[q]\n"                             \
    "ldrd %[x], %[y], [%[of], #" of_bias "]\n"

/* Replaces the sums by u, and returns the sum of u. Adds the sum of u^2 to *squares. */
static inline int32_t sw_norm_sums(int32_t *restrict sums, const int32_t channel[][4][8], int64_t *squares, int width)
{
    int32_t b, m, n, x, y, r, q, sum = 0;
    uint32_t low = 0, high = 0;
    const int32_t *of = &channel[0][0][0];
    const int32_t *end = sums + SW_PADDED(width);
    __asm__ volatile(
        "sub sp, #8\n" "str %[a], [sp]\n"
        "1:\n" "ldrd %[a], %[b], [%[s]]\n" "ldrd %[m], %[n], [%[of]]\n" "ldrd %[x], %[y], [%[of], #32]\n"
        SW_TWO_SUMS("0", "4", SW_SUMS_AT("8", "40"))
        SW_TWO_SUMS("8", "12", SW_SUMS_AT("16", "48"))
        SW_TWO_SUMS("16", "20", SW_SUMS_AT("24", "56"))
        SW_TWO_SUMS("24", "28", "smlal %[low], %[high], %[r], %[r]\n" "smlal %[low], %[high], %[q], %[q]\n")
        "ldr %[a], [sp]\n" "add %[s], #32\n" "add %[of], #128\n" "cmp %[s], %[a]\n" "bne 1b\n" "add sp, #8\n"
        : [s] "+r"(sums), [of] "+r"(of), [sum] "+r"(sum), [low] "+r"(low), [high] "+r"(high), [a] "+r"(end),
          [b] "=&r"(b), [m] "=&r"(m), [n] "=&r"(n), [x] "=&r"(x), [y] "=&r"(y), [r] "=&r"(r), [q] "=&r"(q)
        : : "cc", "memory");
    *squares = (int64_t)((uint64_t)high << 32 | low);
    return sum;
}

/* Computes xhat, h and ELU' of two outputs. */
#define SW_TWO_OUTPUTS(sum, gain, offset, second, xhat, slope, other)                                       \
    "ldrd %[a], %[b], [%[s], #" sum "]\n"          "ldrd %[g], %[h], [%[of], #" gain "]\n"                  \
    "smmlar %[a], %[a], %[factor], %[shift]\n"     "ldr %[e], [%[of], #" offset "]\n"                       \
    "smmlar %[b], %[b], %[factor], %[shift]\n"                                                              \
    "smlawb %[g], %[g], %[a], %[e]\n"                                                                       \
    "ldr %[e], [%[of], #" second "]\n"             "pkhbt %[a], %[a], %[b], lsl #16\n"                      \
    "str %[a], [%[tape], #" xhat "]\n"             "usat %[g], #22, %[g]\n"                                 \
    "smlawb %[h], %[h], %[b], %[e]\n"              "lsr %[a], %[g], #13\n"                                  \
    "ldr %[a], [%[points], %[a], lsl #2]\n"        "ubfx %[g], %[g], #0, #13\n"                             \
    "usat %[h], #22, %[h]\n"                                                                                \
    "lsr %[b], %[h], #13\n"                        "smlabt %[g], %[g], %[a], %[one]\n"                      \
    "ldr %[b], [%[points], %[b], lsl #2]\n"        "ubfx %[h], %[h], #0, #13\n"                             \
    "add %[a], %[a], %[g], asr #13\n"                                                                       \
    "smlabt %[h], %[h], %[b], %[one]\n"            "sxtah %[g], %[one], %[a]\n"                             \
    "usat %[g], #8, %[g], asr #4\n"                                                                         \
    "strb %[g], [%[tape], #" slope "]\n"           "add %[b], %[b], %[h], asr #13\n"                        \
    "pkhbt %[a], %[a], %[b], lsl #16\n"            "sxtah %[h], %[one], %[b]\n"                             \
    "str %[a], [%[hidden]], #4\n"                  "usat %[h], #8, %[h], asr #4\n"                          \
    "strb %[h], [%[tape], #" other "]\n"

/* Computes xhat = shift + u * factor, y = gain * xhat + offset, h = ELU(y) and ELU'(y). */
static inline void sw_norm_outputs(const int32_t *restrict u, sw_tape_eight *restrict tape, int16_t *restrict hidden,
                                   const int32_t channel[][4][8], int32_t factor, int32_t shift, int width)
{
    int32_t b, g, h, e;
    const int32_t one = SW_ELU_ONE;
    const int32_t *of = &channel[0][0][0];
    const int32_t *end = u + SW_PADDED(width);
    __asm__ volatile(
        "sub sp, #8\n" "str %[a], [sp]\n" "1:\n"
        SW_TWO_OUTPUTS("0", "64", "96", "100", "0", "16", "17")
        SW_TWO_OUTPUTS("8", "72", "104", "108", "4", "18", "19")
        SW_TWO_OUTPUTS("16", "80", "112", "116", "8", "20", "21")
        SW_TWO_OUTPUTS("24", "88", "120", "124", "12", "22", "23")
        "ldr %[a], [sp]\n" "add %[s], #32\n" "add %[of], #128\n" "add %[tape], #24\n" "cmp %[s], %[a]\n" "bne 1b\n" "add sp, #8\n"
        : [s] "+r"(u), [of] "+r"(of), [tape] "+r"(tape), [hidden] "+r"(hidden), [a] "+r"(end), [b] "=&r"(b),
          [g] "=&r"(g), [h] "=&r"(h), [e] "=&r"(e)
        : [factor] "r"(factor), [shift] "r"(shift), [one] "r"(one), [points] "r"(sw_elu_points)
        : "cc", "memory");
}

/* clang-format on */

#endif
