/* AES-128 CMAC (NIST SP 800-38B, RFC 4493). The twin of can_bridge/secoc/key.py. */
#ifndef SW_CMAC_H
#define SW_CMAC_H

#include "sw_aes.h"

/* A key that is prepared: a MAC then takes one encryption for each of its blocks. */
typedef struct {
    sw_aes_key aes;
    uint8_t whole[SW_AES_BYTES];  /* goes into a last block that is whole, K1 in RFC 4493 */
    uint8_t padded[SW_AES_BYTES]; /* and into one that is not, K2 */
} sw_cmac_key;

void sw_cmac_prepare(sw_cmac_key *prepared, const uint8_t key[SW_AES_BYTES]);

void sw_cmac(const sw_cmac_key *key, const uint8_t *message, uint32_t length, uint8_t mac[SW_AES_BYTES]);

/* Both at once, by a key that is used once. */
void sw_aes_cmac(const uint8_t key[SW_AES_BYTES], const uint8_t *message, uint32_t length, uint8_t mac[SW_AES_BYTES]);

#endif
