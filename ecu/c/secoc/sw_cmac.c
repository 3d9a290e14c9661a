#include "sw_cmac.h"

/* Multiplies a block by x in GF(2^128). */
static void doubled(uint8_t to[SW_AES_BYTES], const uint8_t block[SW_AES_BYTES])
{
    const uint32_t carry = 0x87u & (0u - ((uint32_t)block[0] >> 7));
    for (int i = 0; i < SW_AES_BYTES - 1; i++) {
        to[i] = (uint8_t)((uint32_t)block[i] << 1 ^ (uint32_t)block[i + 1] >> 7);
    }
    to[SW_AES_BYTES - 1] = (uint8_t)((uint32_t)block[SW_AES_BYTES - 1] << 1 ^ carry);
}

static void add_bytes(uint8_t block[SW_AES_BYTES], const uint8_t *other, uint32_t count)
{
    for (uint32_t i = 0; i < SW_AES_BYTES && i < count; i++) block[i] = (uint8_t)(block[i] ^ other[i]);
}

void sw_cmac_prepare(sw_cmac_key *prepared, const uint8_t key[SW_AES_BYTES])
{
    uint8_t block[SW_AES_BYTES] = {0};
    sw_aes_prepare(&prepared->aes, key);
    sw_aes_encrypt(&prepared->aes, block);
    doubled(prepared->whole, block);
    doubled(prepared->padded, prepared->whole);
}

void sw_cmac(const sw_cmac_key *key, const uint8_t *message, uint32_t length, uint8_t mac[SW_AES_BYTES])
{
    uint32_t at = 0;
    for (uint32_t i = 0; i < SW_AES_BYTES; i++) mac[i] = 0;
    while (length - at > SW_AES_BYTES) {
        add_bytes(mac, &message[at], SW_AES_BYTES);
        sw_aes_encrypt(&key->aes, mac);
        at += SW_AES_BYTES;
    }
    add_bytes(mac, &message[at], length - at);
    if (length - at == SW_AES_BYTES) {
        add_bytes(mac, key->whole, SW_AES_BYTES);
    } else {
        mac[length - at] = (uint8_t)(mac[length - at] ^ 0x80u);
        add_bytes(mac, key->padded, SW_AES_BYTES);
    }
    sw_aes_encrypt(&key->aes, mac);
}

void sw_aes_cmac(const uint8_t key[SW_AES_BYTES], const uint8_t *message, uint32_t length, uint8_t mac[SW_AES_BYTES])
{
    sw_cmac_key prepared;
    sw_cmac_prepare(&prepared, key);
    sw_cmac(&prepared, message, length, mac);
}
