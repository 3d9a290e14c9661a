/* What is this board's: where its registers stand, its clocks, its bit timing, its sectors. Another board with the same
 * kinds of peripherals changes this file and the memories in sw_board.ld, and nothing else. Addresses are those of an
 * STM32H743 (RM0433), but for the counter, which is Arm's (CNTReadBase); its clock tree and pins are for the board's
 * maker, in sw_board_power_on.
 */
#ifndef SW_BOARD_H
#define SW_BOARD_H

#include <stdint.h>

#include "sw_board_start.h"
#include "sw_ecu_state.h"
#include "sw_flash.h"

/* --- The board --- */

#define SW_BOARD_COUNTER 0x5c008000u /* counts ns since power-on */
#define SW_BOARD_RANDOM 0x48021800u
#define SW_BOARD_CAN 0x4000a000u     /* M_CAN's registers */
#define SW_BOARD_CAN_RAM 0x4000ac00u /* its message RAM */
#define SW_BOARD_CAN_INTERRUPT 19u   /* its line 0; it only ends the core's sleep */
#define SW_BOARD_TIMER_INTERRUPT 30u /* the counter's compare value; the same */
#define SW_BOARD_CAN_NS 2000u        /* of the time stamps of received frames: a nominal bit */
/* 80 MHz: 160 quanta a nominal bit, 500 kbit/s; 40 a data bit, 2 Mbit/s; both are sampled behind 80 % and 75 %. */
#define SW_BOARD_CAN_NOMINAL ((31u << 25) | (0u << 16) | (126u << 8) | 31u)
#define SW_BOARD_CAN_DATA ((1u << 23) | (0u << 16) | (28u << 8) | (9u << 4) | 9u)
#define SW_BOARD_CAN_DELAY (30u << 8) /* where a data bit is sampled behind the transceiver's delay, in clocks */
#define SW_BOARD_FLASH 0x52002100u    /* registers of the bank that holds what is written in the field, the second */
#define SW_BOARD_FLASH_BANK 0x08100000u
#define SW_BOARD_FLASH_SECTORS 8u
#define SW_BOARD_BACKUP 0x38800000u /* SRAM that outlives a loss of the supply; sw_board_power_on has it clocked and open */
#define SW_BOARD_ERASE_NS INT64_C(5000000000) /* for a sector, beyond which it has failed: at most 4 s (DS12110) */

/* --- The same for every board --- */

#define SW_BOARD_REGISTER(address) (*(volatile uint32_t *)(uintptr_t)(address))

/* Once a turn of the loop, which takes a control period and a half at most, and after a start, which may erase a sector:
 * here a watchdog is fed. Nothing on the emulated board.
 */
void sw_board_alive(void);

/* ns since power-on. */
int64_t sw_board_now_ns(void);

/* Sleep until a frame comes or until_ns; a wake-up for another reason is allowed. */
void sw_board_sleep(int64_t until_ns);

/* The second bank; its driver has no state. */
extern const sw_flash sw_board_flash;

/* 32 random bits; 0 from a generator that failed is an answer like any other, and *failed then is 1. */
uint32_t sw_board_random(uint8_t *failed);

/* Does not return. */
void sw_board_reset(void);

#define SW_BOARD_EXTENDED 0x80000000u /* marks an identifier of 29 bits */

/* Frames of these identifiers are received, all others refused. */
void sw_board_can_start(const uint32_t *ids, uint32_t count);

/* Everything that has come, oldest first, into at most `room` frames; how many. */
int sw_board_can_receive(sw_frame *frames, int room);

/* Frames of control have a place each, from which they leave before others with greater identifiers. Hand one over; an
 * older one that is still there is out of date, and taken back. 1 if the controller is bus-off or is sending the older
 * one: it is lost. Both that and what is taken back counts in sw_board_lost.
 */
int sw_board_can_send(const sw_frame *frame, uint32_t place);
extern volatile uint32_t sw_board_lost;

/* Frames of diagnosis leave in their order. How many can be handed over now; 0 while the controller is bus-off. */
int sw_board_can_room(void);
void sw_board_can_queue(const sw_frame *frame);

/* Whether all frames that were handed over have left, or never will. */
int sw_board_can_is_idle(void);

#if SW_SECOC
/* The bus' key, and what is left of earlier power cycles, with this one counted where it outlives a loss of the supply.
 * Returns 0, or 1 where that cannot be done: without a key the ECU sends nothing.
 */
int sw_board_authentication(sw_authentication *found);

/* Keeps what was accepted last, behind every step. A value that is kept late can be played back once to an ECU that has
 * just started again.
 */
void sw_board_keep_freshness(const sw_ecu_state *state);
#endif

/* The error counters of now; a controller that went bus-off is counted, and starts again. */
void sw_board_can_health(sw_bus_health *health);

#endif
