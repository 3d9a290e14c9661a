/* The start of a Cortex-M7. The linker script defines the addresses that sw_board_start.c uses. */
#ifndef SW_BOARD_START_H
#define SW_BOARD_START_H

/* The linker's entry point, which runs after a reset. */
void sw_board_start(void);

/* Sets up clocks, pins and watchdog, before memory is initialised. The board's maker implements this function. */
void sw_board_power_on(void);

/* Runs the program, with interrupts masked; it does not return. */
void sw_board_main(void);

/* The handlers of SysTick and of all other exceptions; sw_board_unexpected does not return. */
void sw_board_tick(void);
void sw_board_unexpected(void);

#endif
