/* AES-128 (FIPS 197), encryption alone, and AES-CMAC (NIST SP 800-38B) over it.
 *
 * No table is looked up and no branch is taken by a secret: how long it takes depends on the length of the message
 * alone.
 */
#ifndef SW_AES_H
#define SW_AES_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SW_AES_BYTES 16 /* of a key, of a block, and of a CMAC */

/* Encrypts a block in its place. */
void sw_aes_encrypt(const uint8_t key[SW_AES_BYTES], uint8_t block[SW_AES_BYTES]);

/* The CMAC of a message of `length` bytes. */
void sw_aes_cmac(const uint8_t key[SW_AES_BYTES], const uint8_t *message, uint32_t length, uint8_t mac[SW_AES_BYTES]);

#ifdef __cplusplus
}
#endif

#endif
