/* AES-128 CMAC (NIST SP 800-38B, RFC 4493). This file corresponds to can_bridge/secoc/key.py. */
#ifndef SW_CMAC_H
#define SW_CMAC_H

#include "sw_aes.h"

/* A prepared key, with which a MAC takes one encryption for each block of the message. */
typedef struct {
    sw_aes_key aes;
    uint8_t whole[SW_AES_BYTES];  /* added to a complete last block, K1 in RFC 4493 */
    uint8_t padded[SW_AES_BYTES]; /* added to a padded last block, K2 */
} sw_cmac_key;

void sw_cmac_prepare(sw_cmac_key *prepared, const uint8_t key[SW_AES_BYTES]);

void sw_cmac(const sw_cmac_key *key, const uint8_t *message, uint32_t length, uint8_t mac[SW_AES_BYTES]);

/* Prepares a key and computes one MAC; meant for a key that is used only once. */
void sw_aes_cmac(const uint8_t key[SW_AES_BYTES], const uint8_t *message, uint32_t length, uint8_t mac[SW_AES_BYTES]);

#endif
