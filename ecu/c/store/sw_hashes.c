/* SHA-256 (FIPS 180-4), and SHA-512 for Ed25519. */
#include "sw_crypto.h"

#include "sw_bytes.h"

/* --- SHA-256 --- */

#define BLOCK 64u
#define LENGTH 8u /* number of bytes of the message length at the end of the last block */

/* First 32 bits of the fractional parts of the cube roots of the first 64 primes. */
static const uint32_t rounds[64] = {
    0x428a2f98u, 0x71374491u, 0xb5c0fbcfu, 0xe9b5dba5u, 0x3956c25bu, 0x59f111f1u, 0x923f82a4u, 0xab1c5ed5u,
    0xd807aa98u, 0x12835b01u, 0x243185beu, 0x550c7dc3u, 0x72be5d74u, 0x80deb1feu, 0x9bdc06a7u, 0xc19bf174u,
    0xe49b69c1u, 0xefbe4786u, 0x0fc19dc6u, 0x240ca1ccu, 0x2de92c6fu, 0x4a7484aau, 0x5cb0a9dcu, 0x76f988dau,
    0x983e5152u, 0xa831c66du, 0xb00327c8u, 0xbf597fc7u, 0xc6e00bf3u, 0xd5a79147u, 0x06ca6351u, 0x14292967u,
    0x27b70a85u, 0x2e1b2138u, 0x4d2c6dfcu, 0x53380d13u, 0x650a7354u, 0x766a0abbu, 0x81c2c92eu, 0x92722c85u,
    0xa2bfe8a1u, 0xa81a664bu, 0xc24b8b70u, 0xc76c51a3u, 0xd192e819u, 0xd6990624u, 0xf40e3585u, 0x106aa070u,
    0x19a4c116u, 0x1e376c08u, 0x2748774cu, 0x34b0bcb5u, 0x391c0cb3u, 0x4ed8aa4au, 0x5b9cca4fu, 0x682e6ff3u,
    0x748f82eeu, 0x78a5636fu, 0x84c87814u, 0x8cc70208u, 0x90befffau, 0xa4506cebu, 0xbef9a3f7u, 0xc67178f2u,
};

static uint32_t turned(uint32_t value, uint32_t bits) { return (value >> bits) | (value << (32u - bits)); }

static void mix(sw_sha256 *hash)
{
    uint32_t w[64];
    uint32_t v[8]; /* the working variables a to h */
    for (uint32_t i = 0; i < 8u; i++) v[i] = hash->state[i];
    for (uint32_t i = 0; i < 64u; i++) {
        if (i < 16u) {
            w[i] = sw_big_u32(&hash->block[4u * i]);
        } else {
            const uint32_t x = w[i - 15u];
            const uint32_t y = w[i - 2u];
            w[i] = w[i - 16u] + (turned(x, 7) ^ turned(x, 18) ^ (x >> 3)) + w[i - 7u]
                   + (turned(y, 17) ^ turned(y, 19) ^ (y >> 10));
        }
        const uint32_t one = v[7] + (turned(v[4], 6) ^ turned(v[4], 11) ^ turned(v[4], 25))
                             + ((v[4] & v[5]) ^ (~v[4] & v[6])) + rounds[i] + w[i];
        const uint32_t two = (turned(v[0], 2) ^ turned(v[0], 13) ^ turned(v[0], 22))
                             + ((v[0] & v[1]) ^ (v[0] & v[2]) ^ (v[1] & v[2]));
        for (uint32_t k = 7; k > 0u; k--) v[k] = v[k - 1u];
        v[4] += one;
        v[0] = one + two;
    }
    for (uint32_t i = 0; i < 8u; i++) hash->state[i] += v[i];
}

void sw_sha256_begin(sw_sha256 *hash)
{
    /* First 32 bits of the fractional parts of the square roots of the first 8 primes. */
    static const uint32_t start[8] = {
        0x6a09e667u, 0xbb67ae85u, 0x3c6ef372u, 0xa54ff53au, 0x510e527fu, 0x9b05688cu, 0x1f83d9abu, 0x5be0cd19u,
    };
    for (uint32_t i = 0; i < 8u; i++) hash->state[i] = start[i];
    hash->length = 0;
}

void sw_sha256_add(sw_sha256 *hash, const uint8_t *data, uint32_t length)
{
    for (uint32_t i = 0; i < length; i++) {
        hash->block[hash->length % BLOCK] = data[i];
        hash->length++;
        if (hash->length % BLOCK == 0u) mix(hash);
    }
}

void sw_sha256_end(sw_sha256 *hash, uint8_t digest[32])
{
    static const uint8_t one = 0x80, zero = 0x00;
    const uint64_t bits = hash->length * 8u;
    uint8_t length[LENGTH];
    for (uint32_t i = 0; i < LENGTH; i++) length[i] = (uint8_t)(bits >> (8u * (LENGTH - 1u - i)));
    sw_sha256_add(hash, &one, 1);
    while (hash->length % BLOCK != BLOCK - LENGTH) sw_sha256_add(hash, &zero, 1);
    sw_sha256_add(hash, length, LENGTH);
    for (uint32_t i = 0; i < 32u; i++) digest[i] = (uint8_t)(hash->state[i / 4u] >> (8u * (3u - i % 4u)));
}

void sw_sha256_of(const uint8_t *data, uint32_t length, uint8_t digest[SW_SHA256_BYTES])
{
    sw_sha256 hash;
    sw_sha256_begin(&hash);
    sw_sha256_add(&hash, data, length);
    sw_sha256_end(&hash, digest);
}

/* --- SHA-512 and Ed25519, from Monocypher (vendor/README.md). No code of this project follows. --- */

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wsign-conversion"
#endif
#include "monocypher-ed25519_c.h"
