/* The start of a Cortex-M7: the program provides these functions, and a linker script the addresses in
 * sw_board_start.c.
 */
#ifndef SW_BOARD_START_H
#define SW_BOARD_START_H

/* Runs after a reset: the entry point for the linker. */
void sw_board_start(void);

/* Sets up clocks, pins and watchdog. The board's maker implements this function. The function runs before memory is
 * initialised.
 */
void sw_board_power_on(void);

/* Runs the program, with interrupts masked; it does not return. */
void sw_board_main(void);

/* Handle an exception of SysTick, and every other exception; sw_board_unexpected does not return. */
void sw_board_tick(void);
void sw_board_unexpected(void);

#endif
