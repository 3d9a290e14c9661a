/* The verification of Ed25519 signatures (R, s) with a key A (RFC 8032). In Python, OpenSSL gives the same results.
 * Monocypher's arithmetic computes sB - hA (h: see `challenge`). This point's encoding must equal R byte by byte.
 *
 * Monocypher's own check also accepts an R that differs from this point by a point of small order, and its tables take
 * half a KiB of the stack. This code processes both scalars bit by bit, with one table entry for each point.
 */
#if defined(__GNUC__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wsign-conversion"
#endif
#include "monocypher_c.h"
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

#include "monocypher-ed25519.h"
#include "sw_crypto.h"

#define POINT 32u /* number of bytes of a point, and of a scalar */
#define SCALAR_BITS 253

/* The y coordinates of the points of small order; the last two are not reduced modulo p. Public keys with these values
 * are rejected, because anyone can forge signatures for them.
 */
static const uint8_t small_order[7][POINT] = {
    {0x00},
    {0x01},
    {0x26, 0xe8, 0x95, 0x8f, 0xc2, 0xb2, 0x27, 0xb0, 0x45, 0xc3, 0xf4, 0x89, 0xf2, 0xef, 0x98, 0xf0,
     0xd5, 0xdf, 0xac, 0x05, 0xd3, 0xc6, 0x33, 0x39, 0xb1, 0x38, 0x02, 0x88, 0x6d, 0x53, 0xfc, 0x05},
    {0xc7, 0x17, 0x6a, 0x70, 0x3d, 0x4d, 0xd8, 0x4f, 0xba, 0x3c, 0x0b, 0x76, 0x0d, 0x10, 0x67, 0x0f,
     0x2a, 0x20, 0x53, 0xfa, 0x2c, 0x39, 0xcc, 0xc6, 0x4e, 0xc7, 0xfd, 0x77, 0x92, 0xac, 0x03, 0x7a},
    {0xec, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff,
     0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f},
    {0xed, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff,
     0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f},
    {0xee, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff,
     0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f},
};

static uint32_t bit_of(const uint8_t scalar[POINT], int bit)
{
    return ((uint32_t)scalar[bit / 8] >> (bit % 8)) & 1u;
}

/* Returns whether R is, byte by byte, the encoding of sB - hA. */
static int equals_r(const uint8_t signature[64], const uint8_t key[POINT], const uint8_t h[POINT])
{
    ge sum, work;
    ge_cached minus_a;
    u32 s[8];
    load32_le_buf(s, &signature[POINT], 8);
    if (is_above_l(s) || ge_frombytes_neg_vartime(&work, key) != 0) return 0; /* s >= L, or the key is not a point */
    ge_cache(&minus_a, &work);
    ge_zero(&sum);
    for (int bit = SCALAR_BITS - 1; bit >= 0; bit--) {
        ge_double(&sum, &sum, &work);
        if (bit_of(h, bit) != 0u) ge_add(&sum, &sum, &minus_a);
        if (bit_of(&signature[POINT], bit) != 0u) ge_madd(&sum, &sum, &b_window[0], work.X, work.Y); /* adds B */
    }
    uint8_t found[POINT];
    ge_tobytes(found, &sum);
    return crypto_verify32(found, signature) == 0;
}

int sw_key_is_weak(const uint8_t key[32])
{
    int weak = 0;
    for (uint32_t i = 0; i < 7u; i++) {
        uint32_t different = (uint32_t)(key[POINT - 1u] & 0x7fu) ^ small_order[i][POINT - 1u];
        for (uint32_t k = 0; k + 1u < POINT; k++) different |= (uint32_t)key[k] ^ small_order[i][k];
        if (different == 0u) weak = 1;
    }
    return weak;
}

/* Computes SHA-512 of R, the key and the data, modulo the group's order. */
static void challenge(uint8_t h[POINT], const uint8_t *signature, const uint8_t *key, const uint8_t *data, uint32_t length)
{
    uint8_t hash[64];
    crypto_sha512_ctx sha512;
    crypto_sha512_init(&sha512);
    crypto_sha512_update(&sha512, signature, POINT);
    crypto_sha512_update(&sha512, key, POINT);
    crypto_sha512_update(&sha512, data, length);
    crypto_sha512_final(&sha512, hash);
    crypto_eddsa_reduce(h, hash);
}

int sw_signature_is_good(const uint8_t signature[64], const uint8_t key[32], const uint8_t *data, uint32_t length)
{
    uint8_t h[POINT];
    if (sw_key_is_weak(key)) return 0;
    challenge(h, signature, key, data, length);
    return equals_r(signature, key, h);
}
