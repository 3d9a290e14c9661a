/* The cryptography of the store: SHA-256 (FIPS 180-4), in one call or in parts, and Ed25519 (RFC 8032). */
#ifndef SW_CRYPTO_H
#define SW_CRYPTO_H

#include <stdint.h>

#define SW_SHA256_BYTES 32u

typedef struct {
    uint32_t state[8];
    uint8_t block[64];
    uint64_t length; /* number of bytes hashed so far */
} sw_sha256;

void sw_sha256_begin(sw_sha256 *hash);
void sw_sha256_add(sw_sha256 *hash, const uint8_t *data, uint32_t length);
void sw_sha256_end(sw_sha256 *hash, uint8_t digest[SW_SHA256_BYTES]);

/* Computes the digest of the whole data in one call. */
void sw_sha256_of(const uint8_t *data, uint32_t length, uint8_t digest[SW_SHA256_BYTES]);

/* Returns whether a public key is of small order. Anyone can forge signatures that such a key accepts. */
int sw_key_is_weak(const uint8_t key[32]);

/* Returns whether this key signed these bytes; 0 for every key of small order. */
int sw_signature_is_good(const uint8_t signature[64], const uint8_t key[32], const uint8_t *data, uint32_t length);

#endif
