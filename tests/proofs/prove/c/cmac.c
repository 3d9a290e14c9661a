/* AES-CMAC: messages of any length, and keys of any bytes. The values are compared with those of another library. */
#include "prove.h"

#include "sw_cmac.c"

#define MOST 58u /* bytes: the longest frame without its MAC, and its data ID */

void sw_aes_encrypt(const sw_aes_key *key, uint8_t block[SW_AES_BYTES])
{
    (void)key;
    block[0] = block[SW_AES_BYTES - 1] = nondet_uchar();
}

void sw_aes_prepare(sw_aes_key *prepared, const uint8_t key[SW_AES_BYTES])
{
    (void)prepared, (void)(uint8_t)(key[0] | key[SW_AES_BYTES - 1]);
}

/* At the end of its array, so that a byte too many is out of bounds. */
void any_message(void)
{
    sw_cmac_key key;
    uint8_t room[MOST], mac[SW_AES_BYTES];
    const uint32_t length = nondet_uint();
    ASSUME(length <= MOST);
    sw_cmac(&key, &room[MOST - length], length, mac);
}

void any_key(void)
{
    uint8_t key[SW_AES_BYTES], mac[SW_AES_BYTES];
    sw_cmac_key prepared;
    sw_cmac_prepare(&prepared, key);
    sw_aes_cmac(key, key, SW_AES_BYTES, mac);
}
