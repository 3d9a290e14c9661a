/* sw_dots.h for cores with the Arm DSP extension (Cortex-M4, M7, M33): an instruction adds two products to a sum.
 *
 * The loops are written in assembly, because compilers run out of registers in them. The instructions are ordered for
 * cores that issue two instructions at a time. Each loop needs thirteen registers. Values that are used only once per
 * pass over the columns are on the stack.
 */
#ifndef SW_DOTS_DSP_H
#define SW_DOTS_DSP_H

#include "sw_workspace.h"

/* Instructions on one line belong to one operation. */
/* clang-format off */

/* Sign extensions alternate with multiplications. Weights are loaded two rows ahead, so the last loads read from the
 * SW_AHEAD bytes that follow every matrix.
 */
#define SW_ONE_TILE                                                                                        \
    "ldrd %[xa], %[xb], [%[x]], #8\n" "sxtb16 %[t], %[wa]\n" "sxtb16 %[u], %[wa], ror #8\n"                \
    "ldr %[wa], [%[w]], #4\n" "smlad %[s0], %[t], %[xa], %[s0]\n" "sxtb16 %[t], %[wb]\n"                   \
    "smlad %[s0], %[u], %[xb], %[s0]\n" "sxtb16 %[u], %[wb], ror #8\n" "smlad %[s1], %[t], %[xa], %[s1]\n" \
    "ldr %[wb], [%[w]], #4\n" "sxtb16 %[t], %[wa]\n" "smlad %[s1], %[u], %[xb], %[s1]\n"                   \
    "sxtb16 %[u], %[wa], ror #8\n" "smlad %[s2], %[t], %[xa], %[s2]\n" "ldr %[wa], [%[w]], #4\n"           \
    "sxtb16 %[t], %[wb]\n" "smlad %[s2], %[u], %[xb], %[s2]\n" "sxtb16 %[u], %[wb], ror #8\n"              \
    "smlad %[s3], %[t], %[xa], %[s3]\n" "ldr %[wb], [%[w]], #4\n" "smlad %[s3], %[u], %[xb], %[s3]\n"

#define SW_EIGHT_COLUMNS SW_ONE_TILE SW_ONE_TILE
#define SW_SIXTEEN_COLUMNS "2:\n" "subs %[count], #1\n" SW_EIGHT_COLUMNS SW_EIGHT_COLUMNS "bne 2b\n"

/* The stack has y, the number of rows left, the bytes of a vector, and the number of groups of sixteen columns. */
#define SW_FOUR_ROWS(columns)                                                                            \
    __asm__ volatile("sub sp, #16\n" "strd %[s0], %[s1], [sp]\n" "strd %[s2], %[s3], [sp, #8]\n"           \
                     "ldr %[wa], [%[w]], #4\n" "ldr %[wb], [%[w]], #4\n"                                     \
                     "1:\n" "ldr %[count], [sp, #12]\n" "mov %[s0], #0\n" "mov %[s1], #0\n"                  \
                     "mov %[s2], #0\n" "mov %[s3], #0\n" columns                                             \
                     "ldrd %[t], %[count], [sp]\n" "ldr %[u], [sp, #8]\n"                                    \
                     "str %[s0], [%[t]], #4\n" "subs %[count], #4\n" "str %[s1], [%[t]], #4\n"              \
                     "sub %[x], %[x], %[u]\n" "strd %[s2], %[s3], [%[t]], #8\n"                             \
                     "strd %[t], %[count], [sp]\n" "bne 1b\n" "add sp, #16\n"                               \
                     : [x] "+r"(x), [w] "+r"(w), [s0] "+r"(y), [s1] "+r"(rows), [s2] "+r"(bytes),            \
                       [s3] "+r"(sixteens), [wa] "=&r"(wa), [wb] "=&r"(wb), [xa] "=&r"(xa), [xb] "=&r"(xb),  \
                       [t] "=&r"(t), [u] "=&r"(u), [count] "=&r"(count) : : "cc", "memory")

/* clang-format on */

/* Computes sw_dots for a multiple of sixteen columns. Only sw_decoder.c has the code, as a copy takes 0.4 KiB. */
void sw_dots_sixteens(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows, int columns);

static inline void sw_dots(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows,
                           int columns)
{
    int32_t wa, wb, xa, xb, t, u, count, bytes = 2 * columns, sixteens = columns / 16;
    /* The compiler chooses the branch, since the sizes are constants. */
    if (columns % 16 == 0) {
        sw_dots_sixteens(y, w, x, rows, columns);
    } else if (columns == 8) {
        SW_FOUR_ROWS(SW_EIGHT_COLUMNS);
    } else {
        SW_FOUR_ROWS(SW_EIGHT_COLUMNS SW_SIXTEEN_COLUMNS);
    }
}

/* clang-format off */

/* Multiplies two rows of a tile by both vectors, x and z. Eight multiplications alternate with other instructions. */
#define SW_TWO_ROWS                                                                                          \
    "smlad %[s0], %[t], %[za], %[s0]\n" "ldr %[u], [%[w]], #12\n"                                           \
    "smlad %[s1], %[t], %[xa], %[s1]\n" "sxtb16 %[wa], %[wa], ror #8\n"                                     \
    "smlad %[s0], %[wa], %[zb], %[s0]\n" "sxtb16 %[t], %[u]\n"                                              \
    "smlad %[s1], %[wa], %[xb], %[s1]\n" "ldr %[wa], [%[w]], #4\n"                                          \
    "smlad %[s2], %[t], %[za], %[s2]\n" "sxtb16 %[u], %[u], ror #8\n"                                       \
    "smlad %[s3], %[t], %[xa], %[s3]\n" "sxtb16 %[t], %[wa]\n"                                              \
    "smlad %[s2], %[u], %[zb], %[s2]\n" "ldrd %[za], %[zb], [%[x], %[apart]]\n"                             \
    "smlad %[s3], %[u], %[xb], %[s3]\n" "ldrd %[xa], %[xb], [%[x]], #8\n"

/* Multiplies pairs of rows by both vectors; every second pair begins in the middle of a tile. The stack has y at 0, the
 * number of rows left at 4, the bytes by which w and x advance in a row of tiles (with loads ahead) at 8 and 12, the
 * address of w after the last tile at 16, and at 20 the distance from this address to the next pair, which alternates.
 */
#define SW_TWO_ROWS_TWICE(tiles)                                                                                 \
    __asm__ volatile("sub sp, #24\n" "strd %[s0], %[s1], [sp]\n" "strd %[s2], %[s3], [sp, #8]\n"           \
                     "rsb %[t], %[s2], #12\n" "str %[t], [sp, #20]\n" "1:\n"                                 \
                     "ldr %[u], [sp, #8]\n" "ldr %[wa], [%[w]], #4\n" "mov %[s0], #0\n"                     \
                     "ldrd %[za], %[zb], [%[x], %[apart]]\n" "mov %[s1], #0\n" "add %[u], %[w]\n"            \
                     "ldrd %[xa], %[xb], [%[x]], #8\n" "sub %[u], #8\n" "mov %[s2], #0\n"                    \
                     "str %[u], [sp, #16]\n" "sxtb16 %[t], %[wa]\n" "mov %[s3], #0\n"                        \
                     "2:\n" tiles "ldr %[u], [sp, #16]\n" "cmp %[w], %[u]\n" "bne 2b\n"                     \
                     "ldrd %[t], %[u], [sp]\n" "ldr %[wa], [sp, #20]\n" "str %[s1], [%[t]]\n"               \
                     "ldrd %[za], %[zb], [sp, #8]\n" "str %[s3], [%[t], #4]\n" "add %[w], %[wa]\n"           \
                     "str %[s0], [%[t], %[along]]\n" "add %[t], #4\n" "add %[wa], %[za]\n"                   \
                     "str %[s2], [%[t], %[along]]\n" "sub %[x], %[zb]\n" "rsb %[wa], %[wa], #0\n"            \
                     "str %[wa], [sp, #20]\n" "add %[t], #4\n" "subs %[u], #2\n"                            \
                     "strd %[t], %[u], [sp]\n" "bne 1b\n" "add sp, #24\n"                                   \
                     : [x] "+r"(x), [w] "+r"(w), [s0] "+r"(y), [s1] "+r"(rows), [s2] "+r"(past),             \
                       [s3] "+r"(bytes), [wa] "=&r"(wa), [za] "=&r"(za), [zb] "=&r"(zb), [xa] "=&r"(xa),     \
                       [xb] "=&r"(xb), [t] "=&r"(t), [u] "=&r"(u)                                            \
                     : [apart] "i"(2 * SW_APART), [along] "i"(4 * SW_APART) : "cc", "memory")

/* clang-format on */

static inline void sw_dots_two(int32_t *restrict y, const int8_t *restrict w, const int16_t *restrict x, int rows,
                               int columns)
{
#if SW_APART > 510 /* the distance exceeds the largest offset of an instruction */
    sw_dots(y, w, x, rows, columns);
    sw_dots(y + SW_APART, w, x + SW_APART, rows, columns);
#else
    int32_t wa, za, zb, xa, xb, t, u, past = 4 * columns + 8, bytes = 2 * columns + 8;
    if (columns % 16 == 0) {
        SW_TWO_ROWS_TWICE(SW_TWO_ROWS SW_TWO_ROWS SW_TWO_ROWS SW_TWO_ROWS);
    } else {
        SW_TWO_ROWS_TWICE(SW_TWO_ROWS SW_TWO_ROWS);
    }
#endif
}

#endif
