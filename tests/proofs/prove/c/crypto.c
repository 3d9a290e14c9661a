/* AES-128 and SHA-256: any key, any block, and any number of pieces of any bytes. */
#include "eva.h"

#include "sw_aes.h"
#include "sw_crypto.h"

#define MOST 64u

void any_block(void)
{
    static sw_aes_key prepared;
    static uint8_t key[SW_AES_BYTES], block[SW_AES_BYTES];
    ANY(key);
    ANY(block);
    sw_aes_prepare(&prepared, key);
    while (any_int) sw_aes_encrypt(&prepared, block);
}

void any_digest(void)
{
    static sw_sha256 hash; /* the store's scratch memory is set at power-on, too */
    static uint8_t data[MOST], digest[SW_SHA256_BYTES];
    sw_sha256_begin(&hash);
    while (any_int) {
        ANY(data);
        sw_sha256_add(&hash, data, Frama_C_unsigned_int_interval(0, MOST));
    }
    sw_sha256_end(&hash, digest);
}
