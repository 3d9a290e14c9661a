/* AES-128 (FIPS 197), encryption only. The caller provides the memory for the schedule of a key.
 *
 * The code has no table, and no branch depends on a secret, so the time does not depend on the key or the data.
 */
#ifndef SW_AES_H
#define SW_AES_H

#include <stdint.h>

#define SW_AES_BYTES 16 /* number of bytes of a key, and of a block */
#define SW_AES_ROUNDS 10
#define SW_AES_PLANES 8 /* number of bits of a byte */

typedef struct {
    uint16_t rounds[SW_AES_ROUNDS + 1][SW_AES_PLANES]; /* the key and the round keys, as planes (sw_aes.c) */
} sw_aes_key;

void sw_aes_prepare(sw_aes_key *prepared, const uint8_t key[SW_AES_BYTES]);

void sw_aes_encrypt(const sw_aes_key *key, uint8_t block[SW_AES_BYTES]);

#endif
