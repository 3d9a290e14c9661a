/* Ed25519 signatures (RFC 8032), judged as OpenSSL judges them, which verifies the same images in Python.
 *
 * Monocypher allows any difference of small order between both sides of the equation; OpenSSL compares R byte by byte.
 * What Monocypher takes is therefore compared once more in that way: this can refuse more, and never take more.
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
#include "sw_keys.h"

#define POINT 32u /* bytes of one, and of a scalar */
#define SCALAR_BITS 253

/* y of the points that eight times are nothing, the last two not reduced: anyone can sign anything for these keys. */
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

/* y of the base point, 4/5, and its x is even. */
static const uint8_t base[POINT] = {
    0x58, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66,
    0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66, 0x66,
};

static uint32_t bit_of(const uint8_t scalar[POINT], int bit)
{
    return ((uint32_t)scalar[bit / 8] >> (bit % 8)) & 1u;
}

/* Whether R is, byte by byte, the encoding of sB - hA. */
static int equals_r(const uint8_t signature[64], const uint8_t key[POINT], const uint8_t h[POINT])
{
    ge minus_a, minus_b, sum, work;
    ge_cached a, b;
    uint8_t found[POINT];
    (void)ge_frombytes_neg_vartime(&minus_a, key); /* a point: Monocypher has taken it */
    (void)ge_frombytes_neg_vartime(&minus_b, base);
    ge_cache(&a, &minus_a);
    ge_cache(&b, &minus_b);
    ge_zero(&sum);
    for (int bit = SCALAR_BITS - 1; bit >= 0; bit--) {
        ge_double(&sum, &sum, &work);
        if (bit_of(h, bit) != 0u) ge_add(&sum, &sum, &a);
        if (bit_of(&signature[POINT], bit) != 0u) ge_sub(&sum, &sum, &b);
    }
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

int sw_signature_is_good(const uint8_t signature[64], const uint8_t key[32], const uint8_t *data, uint32_t length)
{
    uint8_t hash[64], h[POINT];
    crypto_sha512_ctx sha512;
    if (sw_key_is_weak(key)) return 0;
    crypto_sha512_init(&sha512);
    crypto_sha512_update(&sha512, signature, POINT);
    crypto_sha512_update(&sha512, key, POINT);
    crypto_sha512_update(&sha512, data, length);
    crypto_sha512_final(&sha512, hash);
    crypto_eddsa_reduce(h, hash);
    return crypto_eddsa_check_equation(signature, key, h) == 0 && equals_r(signature, key, h);
}
