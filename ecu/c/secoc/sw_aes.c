/* AES-128 on planes of bits. A block is stored as eight planes of 16 bits: bit 4 * r + c of plane i is bit i of the
 * byte in row r and column c. A round therefore processes all bytes of a block together.
 */
#include "sw_aes.h"

#define ALL 0xffffu /* all bits of a plane */
#define COLUMNS 4u

static void to_planes(uint32_t planes[SW_AES_PLANES], const uint8_t block[SW_AES_BYTES])
{
    for (uint32_t i = 0; i < SW_AES_PLANES; i++) planes[i] = 0;
    for (uint32_t at = 0; at < SW_AES_BYTES; at++) {
        const uint32_t place = COLUMNS * (at % COLUMNS) + at / COLUMNS;
        for (uint32_t i = 0; i < SW_AES_PLANES; i++) planes[i] |= ((uint32_t)block[at] >> i & 1u) << place;
    }
}

static void from_planes(uint8_t block[SW_AES_BYTES], const uint32_t planes[SW_AES_PLANES])
{
    for (uint32_t at = 0; at < SW_AES_BYTES; at++) {
        const uint32_t place = COLUMNS * (at % COLUMNS) + at / COLUMNS;
        uint32_t byte = 0;
        for (uint32_t i = 0; i < SW_AES_PLANES; i++) byte |= (planes[i] >> place & 1u) << i;
        block[at] = (uint8_t)byte;
    }
}

/* SubBytes: the straight-line program with 32 ANDs by Boyar and Peralta ("A depth-16 circuit for the AES S-box", 2011).
 * The names are from the paper, where x0 and s0 are the highest bits.
 */
static void substitute(uint32_t planes[SW_AES_PLANES])
{
    const uint32_t x0 = planes[7], x1 = planes[6], x2 = planes[5], x3 = planes[4];
    const uint32_t x4 = planes[3], x5 = planes[2], x6 = planes[1], x7 = planes[0];
    /* The change to a basis in which the inverse needs few operations. */
    const uint32_t y14 = x3 ^ x5, y13 = x0 ^ x6, y9 = x0 ^ x3, y8 = x0 ^ x5, t0 = x1 ^ x2;
    const uint32_t y1 = t0 ^ x7, y4 = y1 ^ x3, y12 = y13 ^ y14, y2 = y1 ^ x0, y5 = y1 ^ x6;
    const uint32_t y3 = y5 ^ y8, t1 = x4 ^ y12, y15 = t1 ^ x5, y20 = t1 ^ x1, y6 = y15 ^ x7;
    const uint32_t y10 = y15 ^ t0, y11 = y20 ^ y9, y7 = x7 ^ y11, y17 = y10 ^ y11, y19 = y10 ^ y8;
    const uint32_t y16 = t0 ^ y11, y21 = y13 ^ y16, y18 = x0 ^ y16;
    /* The inverse in GF(2^8). */
    const uint32_t t2 = y12 & y15, t4 = (y3 & y6) ^ t2, t6 = (y4 & x7) ^ t2;
    const uint32_t t7 = y13 & y16, t9 = (y5 & y1) ^ t7, t11 = (y2 & y7) ^ t7;
    const uint32_t t12 = y9 & y11, t14 = (y14 & y17) ^ t12, t16 = (y8 & y10) ^ t12;
    const uint32_t t21 = t4 ^ t14 ^ y20, t22 = t6 ^ t16 ^ y19, t23 = t9 ^ t14 ^ y21, t24 = t11 ^ t16 ^ y18;
    const uint32_t t25 = t21 ^ t22, t26 = t21 & t23, t27 = t24 ^ t26, t29 = (t25 & t27) ^ t22;
    const uint32_t t30 = t23 ^ t24, t31 = t22 ^ t26, t33 = (t31 & t30) ^ t24, t34 = t23 ^ t33;
    const uint32_t t36 = t24 & (t27 ^ t33), t37 = t36 ^ t34, t38 = t27 ^ t36, t40 = t25 ^ (t29 & t38);
    const uint32_t t41 = t40 ^ t37, t42 = t29 ^ t33, t43 = t29 ^ t40, t44 = t33 ^ t37, t45 = t42 ^ t41;
    const uint32_t z0 = t44 & y15, z1 = t37 & y6, z2 = t33 & x7, z3 = t43 & y16, z4 = t40 & y1, z5 = t29 & y7;
    const uint32_t z6 = t42 & y11, z7 = t45 & y17, z8 = t41 & y10, z9 = t44 & y12, z10 = t37 & y3, z11 = t33 & y4;
    const uint32_t z12 = t43 & y13, z13 = t40 & y5, z14 = t29 & y2, z15 = t42 & y9, z16 = t45 & y14, z17 = t41 & y8;
    /* The change back to the first basis, and the affine map. */
    const uint32_t t46 = z15 ^ z16, t48 = z5 ^ z13, t53 = z0 ^ z3, t54 = z6 ^ z7, t57 = z2 ^ z12 ^ t53;
    const uint32_t t58 = z4 ^ t46, t59 = z3 ^ t54, t60 = t46 ^ t57, t61 = z14 ^ t57, t62 = z7 ^ z8 ^ t58;
    const uint32_t t63 = z9 ^ z10 ^ t58, t64 = z4 ^ t59, t65 = t61 ^ t62, t66 = z1 ^ t63, s3 = t53 ^ t66;
    planes[7] = t59 ^ t63;
    planes[6] = t64 ^ s3 ^ ALL;
    planes[5] = z16 ^ z17 ^ t64 ^ t65 ^ ALL;
    planes[4] = s3;
    planes[3] = z2 ^ z5 ^ t66;
    planes[2] = z10 ^ z11 ^ t65;
    planes[1] = z12 ^ t48 ^ t62 ^ ALL;
    planes[0] = t48 ^ t60 ^ ALL;
}

/* ShiftRows: row r moves r columns to the left. A row is four bits of each plane. */
static void shift_rows(uint32_t planes[SW_AES_PLANES])
{
    for (uint32_t i = 0; i < SW_AES_PLANES; i++) {
        const uint32_t a = planes[i];
        planes[i] = (a & 0x000fu) | (a >> 1 & 0x0070u) | (a << 3 & 0x0080u) | (a >> 2 & 0x0300u) | (a << 2 & 0x0c00u) |
                    (a >> 3 & 0x1000u) | (a << 1 & 0xe000u);
    }
}

/* Moves the rows of a plane up by `rows` places. */
static uint32_t rows_up(uint32_t plane, uint32_t rows)
{
    return (plane >> COLUMNS * rows | plane << (16u - COLUMNS * rows)) & ALL;
}

/* MixColumns: a byte a becomes 2 * s + b + t. Here b is the next row's byte, s = a + b, and t is s two rows below. */
static void mix_columns(uint32_t planes[SW_AES_PLANES])
{
    uint32_t next[SW_AES_PLANES];
    uint32_t sum[SW_AES_PLANES];
    for (uint32_t i = 0; i < SW_AES_PLANES; i++) {
        next[i] = rows_up(planes[i], 1);
        sum[i] = planes[i] ^ next[i];
    }
    for (uint32_t i = 0; i < SW_AES_PLANES; i++) {
        /* The highest bit, when doubled, becomes x^4 + x^3 + x + 1. */
        const uint32_t carried = (0x1bu >> i & 1u) != 0u ? sum[SW_AES_PLANES - 1] : 0u;
        const uint32_t doubled = (i > 0u ? sum[i - 1u] : 0u) ^ carried;
        planes[i] = doubled ^ next[i] ^ rows_up(sum[i], 2);
    }
}

static void add_key(uint32_t planes[SW_AES_PLANES], const uint16_t key[SW_AES_PLANES])
{
    for (uint32_t i = 0; i < SW_AES_PLANES; i++) planes[i] ^= key[i];
}

/* Replaces a round key by the next round key. The last column is moved up by a row, substituted, and added to the first
 * column. Then each column is added to the next column.
 */
static void next_key(uint32_t key[SW_AES_PLANES], uint32_t constant)
{
    uint32_t turned[SW_AES_PLANES];
    for (uint32_t i = 0; i < SW_AES_PLANES; i++) turned[i] = rows_up(key[i], 1);
    substitute(turned);
    for (uint32_t i = 0; i < SW_AES_PLANES; i++) {
        const uint32_t first = key[i] ^ (turned[i] >> 3 & 0x1111u) ^ (constant >> i & 1u);
        const uint32_t two = first ^ (first << 1 & 0xeeeeu);
        key[i] = two ^ (two << 2 & 0xccccu);
    }
}

void sw_aes_prepare(sw_aes_key *prepared, const uint8_t key[SW_AES_BYTES])
{
    uint32_t planes[SW_AES_PLANES];
    uint32_t constant = 1;
    to_planes(planes, key);
    for (uint32_t round = 0; round <= SW_AES_ROUNDS; round++) {
        for (uint32_t i = 0; i < SW_AES_PLANES; i++) prepared->rounds[round][i] = (uint16_t)planes[i];
        next_key(planes, constant);
        constant = constant << 1 ^ (0x11bu & (0u - (constant >> 7)));
    }
}

void sw_aes_encrypt(const sw_aes_key *key, uint8_t block[SW_AES_BYTES])
{
    uint32_t planes[SW_AES_PLANES];
    to_planes(planes, block);
    add_key(planes, key->rounds[0]);
    for (uint32_t round = 1; round <= SW_AES_ROUNDS; round++) {
        substitute(planes);
        shift_rows(planes);
        if (round < SW_AES_ROUNDS) mix_columns(planes);
        add_key(planes, key->rounds[round]);
    }
    from_planes(block, planes);
}
