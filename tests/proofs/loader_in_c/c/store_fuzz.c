/* Images from stdin through a store: rules, a key list with its length, then images with length and SHA-256; a byte for
 * each comes back, its verdict, or 0x80 and why it was not taken.
 */
#include <stdio.h>

#include "store_twin.c"

static twin one;
static uint8_t data[1u << 20];

static uint32_t taken(uint32_t length) { return (uint32_t)fread(data, 1, length, stdin); }

static uint32_t number(void)
{
    uint8_t found[4];
    return fread(found, 1, 4, stdin) == 4u ? sw_big_u32(found) : 0xffffffffu;
}

int main(void)
{
    if (taken((uint32_t)sizeof(sw_rules)) != sizeof(sw_rules)) return 2;
    twin_erased(&one, data);
    twin_power_on(&one, NEVER, 0);
    if (sw_store_take_keys(&one.store, data, taken(number())) != SW_STORE_DONE) return 3;
    for (uint32_t length = number(); length != 0xffffffffu; length = number()) {
        uint8_t sha256[32];
        sw_store_result result;
        if (fread(sha256, 1, 32, stdin) != 32u || length > sizeof(data) || taken(length) != length) return 4;
        result = sw_store_announce(&one.store, length, sha256);
        while (result == SW_STORE_MORE) result = sw_store_go_on(&one.store);
        if (result == SW_STORE_DONE) {
            const uint32_t wanted = one.store.wanted; /* all of it is there if the same one came before */
            result = sw_store_append(&one.store, &data[wanted], length - wanted);
        }
        if (result == SW_STORE_DONE) result = sw_store_finish(&one.store);
        while (result == SW_STORE_MORE) result = sw_store_go_on(&one.store);
        (void)putchar(result == SW_STORE_DONE ? (int)one.store.verdict : (int)(0x80u | (uint32_t)result));
    }
    return one.twice > 0u ? 5 : 0;
}
