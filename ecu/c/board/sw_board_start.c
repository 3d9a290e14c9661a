/* The vector table, and the code between a reset and the program. */
#include "sw_board_start.h"

#include <stddef.h>
#include <stdint.h>

#define COPROCESSORS (*(volatile uint32_t *)0xe000ed88u)

void *memcpy(void *restrict to, const void *restrict from, size_t count);
void *memset(void *to, int value, size_t count);

extern unsigned char sw_board_data[], sw_board_data_end[], sw_board_data_load[], sw_board_bss[], sw_board_bss_end[],
    sw_board_stack_top[];

/* Starts the program. A reset switches off the floating-point unit, which must be on before a function can use it. */
void sw_board_start(void)
{
    __asm__ volatile("cpsid i" ::: "memory");
    COPROCESSORS = 0xfu << 20;
    __asm__ volatile("dsb\n isb" ::: "memory");
    sw_board_power_on();
    memcpy(sw_board_data, sw_board_data_load, (size_t)(sw_board_data_end - sw_board_data));
    memset(sw_board_bss, 0, (size_t)(sw_board_bss_end - sw_board_bss));
    sw_board_main();
    sw_board_unexpected();
}

typedef void (*sw_board_handler)(void);

__attribute__((section(".vectors"), used)) static const struct {
    unsigned char *stack;
    sw_board_handler handlers[15];
} vectors = {
    sw_board_stack_top,
    {sw_board_start, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected,
     sw_board_unexpected, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected,
     sw_board_unexpected, sw_board_unexpected, sw_board_unexpected, sw_board_unexpected, sw_board_tick},
};
