/* AES-128 and AES-CMAC as their standards write them down, the S-box as arithmetic. The twin of
 * can_bridge/secoc/key.py.
 */
#include "sw_aes.h"

#define ROUNDS 10
#define COLUMNS 4

/* In GF(2^8) of AES. */
static uint8_t doubled(uint8_t a) { return (uint8_t)((uint32_t)a << 1 ^ (0x1bu & (0u - ((uint32_t)a >> 7)))); }

static uint8_t multiplied(uint8_t a, uint8_t b)
{
    uint32_t sum = 0;
    for (int bit = 0; bit < 8; bit++) {
        sum ^= (uint32_t)a & (0u - ((uint32_t)b >> bit & 1u));
        a = doubled(a);
    }
    return (uint8_t)sum;
}

static uint32_t turned(uint32_t byte, uint32_t by) { return (byte << by | byte >> (8u - by)) & 0xffu; }

/* The inverse is the 254th power: 0b11111110, by squares and products. */
static uint8_t substituted(uint8_t a)
{
    uint8_t power = a;
    for (int k = 0; k < 6; k++) power = multiplied(multiplied(power, power), a);
    const uint32_t inverse = multiplied(power, power);
    return (uint8_t)(inverse ^ turned(inverse, 1) ^ turned(inverse, 2) ^ turned(inverse, 3) ^ turned(inverse, 4) ^ 0x63u);
}

/* The next round's key, in place of the one before. */
static void next_key(uint8_t key[SW_AES_BYTES], uint8_t constant)
{
    for (int i = 0; i < COLUMNS; i++) {
        key[i] = (uint8_t)(key[i] ^ substituted(key[12 + (i + 1) % COLUMNS]) ^ (i == 0 ? constant : 0u));
    }
    for (int i = COLUMNS; i < SW_AES_BYTES; i++) key[i] = (uint8_t)(key[i] ^ key[i - COLUMNS]);
}

static void add(uint8_t block[SW_AES_BYTES], const uint8_t other[SW_AES_BYTES])
{
    for (int i = 0; i < SW_AES_BYTES; i++) block[i] = (uint8_t)(block[i] ^ other[i]);
}

/* SubBytes and ShiftRows: row r of the columns moves r places to the left. */
static void substitute_and_shift(uint8_t block[SW_AES_BYTES])
{
    uint8_t before[SW_AES_BYTES];
    for (int i = 0; i < SW_AES_BYTES; i++) before[i] = substituted(block[i]);
    for (int i = 0; i < SW_AES_BYTES; i++) block[i] = before[(i + COLUMNS * (i % COLUMNS)) % SW_AES_BYTES];
}

static void mix_columns(uint8_t block[SW_AES_BYTES])
{
    for (int at = 0; at < SW_AES_BYTES; at += COLUMNS) {
        const uint8_t first = block[at];
        const uint8_t all = (uint8_t)(first ^ block[at + 1] ^ block[at + 2] ^ block[at + 3]);
        for (int i = 0; i < COLUMNS; i++) {
            const uint8_t next = i == COLUMNS - 1 ? first : block[at + i + 1];
            block[at + i] = (uint8_t)(block[at + i] ^ all ^ doubled((uint8_t)(block[at + i] ^ next)));
        }
    }
}

void sw_aes_encrypt(const uint8_t key[SW_AES_BYTES], uint8_t block[SW_AES_BYTES])
{
    uint8_t round_key[SW_AES_BYTES];
    uint8_t constant = 1;
    for (int i = 0; i < SW_AES_BYTES; i++) round_key[i] = key[i];
    add(block, round_key);
    for (int round = 1; round <= ROUNDS; round++) {
        substitute_and_shift(block);
        if (round < ROUNDS) mix_columns(block);
        next_key(round_key, constant);
        constant = doubled(constant);
        add(block, round_key);
    }
}

/* A block times x, in GF(2^128): the subkeys of CMAC. */
static void shift(uint8_t block[SW_AES_BYTES])
{
    const uint32_t carry = 0u - ((uint32_t)block[0] >> 7);
    for (int i = 0; i + 1 < SW_AES_BYTES; i++) {
        block[i] = (uint8_t)((uint32_t)block[i] << 1 | (uint32_t)block[i + 1] >> 7);
    }
    block[SW_AES_BYTES - 1] = (uint8_t)((uint32_t)block[SW_AES_BYTES - 1] << 1 ^ (carry & 0x87u));
}

void sw_aes_cmac(const uint8_t key[SW_AES_BYTES], const uint8_t *message, uint32_t length, uint8_t mac[SW_AES_BYTES])
{
    uint8_t last[SW_AES_BYTES] = {0};
    uint32_t at = 0;
    for (int i = 0; i < SW_AES_BYTES; i++) mac[i] = 0;
    while (length - at > SW_AES_BYTES) {
        add(mac, &message[at]);
        sw_aes_encrypt(key, mac);
        at += SW_AES_BYTES;
    }
    sw_aes_encrypt(key, last);
    shift(last);
    if (length - at < SW_AES_BYTES) {
        shift(last);
        last[length - at] = (uint8_t)(last[length - at] ^ 0x80u);
    }
    for (uint32_t i = 0; i < length - at; i++) last[i] = (uint8_t)(last[i] ^ message[at + i]);
    add(mac, last);
    sw_aes_encrypt(key, mac);
}
