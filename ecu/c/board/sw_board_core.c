/* The counter, random numbers, sleep and reset. Interrupts are masked and never served: they only end sleep. */
#include "sw_board.h"

#define COUNTER_LOW SW_BOARD_REGISTER(SW_BOARD_COUNTER)
#define COUNTER_HIGH SW_BOARD_REGISTER(SW_BOARD_COUNTER + 4u)
#define COMPARE_LOW SW_BOARD_REGISTER(SW_BOARD_COUNTER + 8u)
#define COMPARE_HIGH SW_BOARD_REGISTER(SW_BOARD_COUNTER + 12u)
#define RANDOM_CONTROL SW_BOARD_REGISTER(SW_BOARD_RANDOM)
#define RANDOM_STATUS SW_BOARD_REGISTER(SW_BOARD_RANDOM + 4u)
#define RANDOM_DATA SW_BOARD_REGISTER(SW_BOARD_RANDOM + 8u)
#define INTERRUPTS_ENABLED SW_BOARD_REGISTER(0xe000e100u)
#define INTERRUPTS_NOT_PENDING SW_BOARD_REGISTER(0xe000e280u)
#define RESET_CONTROL SW_BOARD_REGISTER(0xe000ed0cu)
#define WAKING ((1u << SW_BOARD_CAN_INTERRUPT) | (1u << SW_BOARD_TIMER_INTERRUPT))
#define WAITS_FOR_RANDOM 1000u
#define RANDOM_SEED_ERROR 0x44u /* SECS, and SEIS, which stays set until the next reset */

int64_t sw_board_now_ns(void)
{
    uint32_t high, low;
    do {
        high = COUNTER_HIGH;
        low = COUNTER_LOW;
    } while (high != COUNTER_HIGH);
    return (int64_t)(((uint64_t)high << 32) | low);
}

/* Sleeps. If a frame has arrived since the last poll, its interrupt is pending and ends the sleep immediately. */
void sw_board_sleep(int64_t until_ns)
{
    COMPARE_LOW = (uint32_t)until_ns;
    COMPARE_HIGH = (uint32_t)((uint64_t)until_ns >> 32);
    __asm__ volatile("dsb\n wfi" ::: "memory");
    INTERRUPTS_NOT_PENDING = WAKING;
}

uint32_t sw_board_random(uint8_t *failed)
{
    uint32_t waits = 0;
    RANDOM_CONTROL = 4u;
    while ((RANDOM_STATUS & 1u) == 0u && waits < WAITS_FOR_RANDOM) waits++;
    const uint32_t bits = RANDOM_DATA;
    *failed = waits == WAITS_FOR_RANDOM || (RANDOM_STATUS & RANDOM_SEED_ERROR) != 0u;
    return bits;
}

void sw_board_reset(void)
{
    __asm__ volatile("dsb" ::: "memory");
    RESET_CONTROL = 0x05fa0004u;
    for (;;) __asm__ volatile("dsb" ::: "memory");
}

/* Enables the interrupts that end the core's sleep. They stay pending and are never served. */
void sw_board_power_on(void) { INTERRUPTS_ENABLED = WAKING; }

void sw_board_alive(void) {}

void sw_board_tick(void) { sw_board_reset(); }

void sw_board_unexpected(void) { sw_board_reset(); }
