/* SHA-256 (FIPS 180-4), in pieces. */
#ifndef SW_SHA256_H
#define SW_SHA256_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    uint32_t state[8];
    uint8_t block[64];
    uint64_t length; /* bytes so far */
} sw_sha256;

void sw_sha256_begin(sw_sha256 *hash);
void sw_sha256_add(sw_sha256 *hash, const uint8_t *data, uint32_t length);
void sw_sha256_end(sw_sha256 *hash, uint8_t digest[32]);

#ifdef __cplusplus
}
#endif

#endif
