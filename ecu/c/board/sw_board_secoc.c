/* The bus key and the freshness values on this board. The key is compiled in, so this firmware must not be shipped; a
 * board for sale must read the key from memory that no debugger can read.
 *
 * Freshness values are in the backup SRAM. It survives a reset and, while a battery supplies VBAT, a loss of the
 * supply. The SRAM does not wear, so every accepted value is stored. If the SRAM loses its content, the ECU counts
 * power cycles from 1, like a new ECU. The other node then refuses every frame, so the jets stay shut. For a board
 * without a battery, change this file to use FRAM or a log in flash.
 *
 * There are two records. The program writes them in turn, so that an interrupted write leaves the other record intact.
 */
#include "sw_board.h"

#if SW_SECOC
#include "sw_board_bus_key.h"

#define RECORDS 2u
#define WORDS 7u
#define NUMBER 0u /* number of the record; the newer record has the later number; 0 follows the largest number */
#define TRIP 1u
#define HEARD_PRESSURE 2u /* freshness value in this word and the next; the low word is first */
#define HEARD_SPEED 4u
#define CHECK 6u
#define BASIS 0x811c9dc5u /* offset basis of the FNV-1a hash */
#define PRIME 0x01000193u

static volatile uint32_t *record(uint32_t which)
{
    return &((volatile uint32_t *)(uintptr_t)SW_BOARD_BACKUP)[WORDS * which];
}

/* Computes the FNV-1a hash over words, not bytes. The result is never 0, because 0 marks an empty record. */
static uint32_t check_of(const volatile uint32_t *words)
{
    uint32_t sum = BASIS;
    for (uint32_t i = 0; i < CHECK; i++) sum = (sum ^ words[i]) * PRIME;
    return sum != 0u ? sum : 1u;
}

/* Returns the newest complete record; RECORDS if there is none. */
static uint32_t newest(void)
{
    uint32_t found = RECORDS;
    for (uint32_t i = 0; i < RECORDS; i++) {
        const volatile uint32_t *words = record(i);
        if (words[CHECK] != check_of(words)) continue;
        if (found == RECORDS || words[NUMBER] - record(found)[NUMBER] <= UINT32_MAX / 2u) found = i;
    }
    return found;
}

static uint64_t pair(const volatile uint32_t *words) { return (uint64_t)words[1] << 32 | words[0]; }

static void keep(uint32_t trip, uint64_t heard_pressure, uint64_t heard_speed)
{
    const uint32_t latest = newest();
    volatile uint32_t *words = record(latest == 0u ? 1u : 0u);
    words[CHECK] = 0;
    words[NUMBER] = latest == RECORDS ? 0u : record(latest)[NUMBER] + 1u;
    words[TRIP] = trip;
    words[HEARD_PRESSURE] = (uint32_t)heard_pressure;
    words[HEARD_PRESSURE + 1u] = (uint32_t)(heard_pressure >> 32);
    words[HEARD_SPEED] = (uint32_t)heard_speed;
    words[HEARD_SPEED + 1u] = (uint32_t)(heard_speed >> 32);
    words[CHECK] = check_of(words);
}

int sw_board_authentication(sw_authentication *found)
{
    static const uint8_t key[SW_AES_BYTES] = SW_BOARD_BUS_KEY;
    const uint32_t latest = newest();
    const volatile uint32_t *words = record(latest == RECORDS ? 0u : latest);
    const uint32_t before = latest == RECORDS ? 0u : words[TRIP];
    for (uint32_t i = 0; i < SW_AES_BYTES; i++) found->key[i] = key[i];
    found->heard_pressure = latest == RECORDS ? 0u : pair(&words[HEARD_PRESSURE]);
    found->heard_speed = latest == RECORDS ? 0u : pair(&words[HEARD_SPEED]);
    if (before == UINT32_MAX) return 1;
    found->trip = before + 1u;
    keep(found->trip, found->heard_pressure, found->heard_speed);
    return 0;
}

void sw_board_keep_freshness(const sw_ecu_state *state)
{
    const uint32_t latest = newest();
    const volatile uint32_t *words = record(latest == RECORDS ? 0u : latest);
    const uint64_t pressure = state->pressures.verifier.freshness;
#if SW_PAST > 0
    const uint64_t speed = state->speed.receiver.verifier.freshness;
#else
    const uint64_t speed = latest == RECORDS ? 0u : pair(&words[HEARD_SPEED]); /* kept for a later release */
#endif
    if (pair(&words[HEARD_PRESSURE]) == pressure && pair(&words[HEARD_SPEED]) == speed) return;
    keep(state->freshness.trip, pressure, speed);
}

#endif
