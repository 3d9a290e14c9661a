/* The counter, random numbers, sleep and reset; and the start of the core from its vector table. No interrupt is served:
 * they are masked for good, and one that is pending only ends the core's sleep.
 */
#include <stddef.h>

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
#define COPROCESSORS SW_BOARD_REGISTER(0xe000ed88u)
#define WAKING ((1u << SW_BOARD_CAN_INTERRUPT) | (1u << SW_BOARD_TIMER_INTERRUPT))
#define WAITS_FOR_RANDOM 1000u

extern unsigned char sw_board_data[], sw_board_data_end[], sw_board_data_load[], sw_board_bss[], sw_board_bss_end[],
    sw_board_stack_top[];

void *memcpy(void *restrict to, const void *restrict from, size_t count);
void *memset(void *to, int value, size_t count);
void __aeabi_memclr(void *to, size_t count);
void __aeabi_memclr4(void *to, size_t count);
void __aeabi_memclr8(void *to, size_t count);
void __aeabi_memcpy(void *restrict to, const void *restrict from, size_t count);
void __aeabi_memcpy4(void *restrict to, const void *restrict from, size_t count);
void __aeabi_memcpy8(void *restrict to, const void *restrict from, size_t count);
void sw_board_start(void);
void sw_board_unexpected(void);

/* --- What compilers call when they clear or copy; a C library would bring it. --- */

void *memcpy(void *restrict to, const void *restrict from, size_t count)
{
    unsigned char *target = to;
    const unsigned char *source = from;
    for (size_t i = 0; i < count; i++) target[i] = source[i];
    return to;
}

void *memset(void *to, int value, size_t count)
{
    unsigned char *target = to;
    for (size_t i = 0; i < count; i++) target[i] = (unsigned char)value;
    return to;
}

void __aeabi_memclr(void *to, size_t count) { memset(to, 0, count); }
void __aeabi_memclr4(void *to, size_t count) { memset(to, 0, count); }
void __aeabi_memclr8(void *to, size_t count) { memset(to, 0, count); }
void __aeabi_memcpy(void *restrict to, const void *restrict from, size_t count) { memcpy(to, from, count); }
void __aeabi_memcpy4(void *restrict to, const void *restrict from, size_t count) { memcpy(to, from, count); }
void __aeabi_memcpy8(void *restrict to, const void *restrict from, size_t count) { memcpy(to, from, count); }

int64_t sw_board_now_ns(void)
{
    uint32_t high, low;
    do {
        high = COUNTER_HIGH;
        low = COUNTER_LOW;
    } while (high != COUNTER_HIGH);
    return (int64_t)(((uint64_t)high << 32) | low);
}

/* A frame that came after the last look is pending, and ends the sleep at once. */
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
    *failed = waits == WAITS_FOR_RANDOM;
    return RANDOM_DATA;
}

void sw_board_reset(void)
{
    __asm__ volatile("dsb" ::: "memory");
    RESET_CONTROL = 0x05fa0004u;
    for (;;) __asm__ volatile("dsb" ::: "memory");
}

void sw_board_power_on(void) {}

void sw_board_alive(void) {}

/* The floating-point unit is off after a reset, and must be on before the first function that might use it. */
void sw_board_start(void)
{
    __asm__ volatile("cpsid i" ::: "memory");
    COPROCESSORS = 0xfu << 20;
    __asm__ volatile("dsb\n isb" ::: "memory");
    sw_board_power_on();
    memcpy(sw_board_data, sw_board_data_load, (size_t)(sw_board_data_end - sw_board_data));
    memset(sw_board_bss, 0, (size_t)(sw_board_bss_end - sw_board_bss));
    INTERRUPTS_ENABLED = WAKING;
    sw_board_main();
    sw_board_reset();
}

/* Any fault. */
void sw_board_unexpected(void) { sw_board_reset(); }

typedef void (*sw_board_handler)(void);

__attribute__((section(".vectors"), used)) static const struct {
    unsigned char *stack;
    sw_board_handler handlers[15];
} vectors = {
    sw_board_stack_top,
    {sw_board_start, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected,
     sw_board_unexpected, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected,
     sw_board_unexpected, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected},
};
