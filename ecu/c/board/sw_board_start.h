/* The start of a Cortex-M7: what a program gives to it, and a linker script with the places that sw_board_start.c names. */
#ifndef SW_BOARD_START_H
#define SW_BOARD_START_H

/* Runs after a reset: the place where the linker's program begins. */
void sw_board_start(void);

/* Clocks, pins, watchdog, for the board's maker. Runs before memory is filled. */
void sw_board_power_on(void);

/* The program, with interrupts masked; it does not return. */
void sw_board_main(void);

/* An exception of SysTick, and any other one; the latter does not return. */
void sw_board_tick(void);
void sw_board_unexpected(void);

#endif
