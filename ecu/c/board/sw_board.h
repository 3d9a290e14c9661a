/* The properties of this board: addresses of registers, clocks, bit timing, sectors. For another board with the same
 * kinds of peripherals, change only this file and the memories in sw_board.ld. The addresses are for an STM32H743
 * (RM0433), except the address of the counter, which Arm defines (CNTReadBase). The board's maker implements
 * sw_board_power_on, which sets up the clocks (also of TIM3) and the pins.
 */
#ifndef SW_BOARD_H
#define SW_BOARD_H

#include <stdint.h>

#include "sw_board_start.h"
#include "sw_ecu_state.h"
#include "sw_flash.h"

/* --- The board --- */

#define SW_BOARD_COUNTER 0x5c008000u /* time since power-on, in ns */
#define SW_BOARD_RANDOM 0x48021800u
#define SW_BOARD_CAN 0x4000a000u     /* registers of M_CAN */
#define SW_BOARD_CAN_RAM 0x4000ac00u /* message RAM of M_CAN */
#define SW_BOARD_CAN_INTERRUPT 19u   /* interrupt number of M_CAN's line 0; the interrupt only ends the core's sleep */
#define SW_BOARD_TIMER_INTERRUPT 30u /* interrupt number of the counter's compare value; it only ends sleep */
#define SW_BOARD_STAMPS 0x40000400u  /* TIM3, whose count M_CAN takes as receive time stamp */
#define SW_BOARD_STAMP_CLOCKS 480u   /* clock cycles of TIM3 (240 MHz) per count of a time stamp */
#define SW_BOARD_CAN_NS 2000u        /* duration of a count, in ns */
/* The clock of M_CAN is 80 MHz. A nominal bit has 160 quanta (500 kbit/s) and is sampled at 80 %; a data bit has 40
 * quanta (2 Mbit/s) and is sampled at 75 %.
 */
#define SW_BOARD_CAN_NOMINAL ((31u << 25) | (0u << 16) | (126u << 8) | 31u)
#define SW_BOARD_CAN_DATA ((1u << 23) | (0u << 16) | (28u << 8) | (9u << 4) | 9u)
#define SW_BOARD_CAN_DELAY (30u << 8) /* sample point of a data bit, in clocks after the measured transceiver delay */
#define SW_BOARD_FLASH 0x52002100u    /* registers of the second bank, which holds the data written in the field */
#define SW_BOARD_FLASH_BANK 0x08100000u
#define SW_BOARD_FLASH_SECTORS 8u
#define SW_BOARD_BACKUP 0x38800000u /* SRAM that survives a loss of the supply; sw_board_power_on enables it */
#define SW_BOARD_ERASE_NS INT64_C(5000000000) /* an erasure fails if it takes longer; the chip takes <= 4 s (DS12110) */

/* --- Declarations that are the same for every board --- */

#define SW_BOARD_REGISTER(address) (*(volatile uint32_t *)(uintptr_t)(address))

/* Feeds a watchdog; does nothing on the emulated board. The program first calls this function after the start-up, which
 * may erase a sector. It then calls the function at least every one and a half control periods.
 */
void sw_board_alive(void);

/* Returns the time since power-on, in ns. */
int64_t sw_board_now_ns(void);

/* Sleeps until a frame arrives or the time until_ns is reached; the function may also return earlier. */
void sw_board_sleep(int64_t until_ns);

/* The driver of the flash's second bank. */
extern const sw_flash sw_board_flash;

/* Returns 32 random bits, which may all be 0. If the generator failed, sets *failed to 1; the bits are then invalid. */
uint32_t sw_board_random(uint8_t *failed);

/* Resets the microcontroller; does not return. */
void sw_board_reset(void);

#define SW_BOARD_EXTENDED 0x80000000u /* marks a 29-bit identifier */

/* Starts to receive frames with these identifiers. The CAN controller discards all other frames. */
void sw_board_can_start(const uint32_t *ids, uint32_t count);

/* Copies the received frames, oldest first, at most `room` frames; returns the number of copied frames. */
int sw_board_can_receive(sw_frame *frames, int room);

/* Writes a control frame to transmit buffer number `place` of the CAN controller, which sends the buffers' frames in
 * the order of their identifiers. An older frame in this buffer is outdated and is cancelled. Returns 1, and the new
 * frame is lost, if the controller is bus-off or is already sending the older frame. sw_board_lost counts lost and
 * cancelled frames.
 */
int sw_board_can_send(const sw_frame *frame, uint32_t place);
extern volatile uint32_t sw_board_lost;

/* Returns how many diagnostic frames the CAN controller can take now; 0 while it is bus-off. */
int sw_board_can_room(void);
void sw_board_can_queue(const sw_frame *frame);

/* Returns 1 if no frame waits to be sent: every frame was sent, or the controller is bus-off. */
int sw_board_can_is_idle(void);

#if SW_SECOC
/* Writes the bus key and the freshness values of earlier power cycles to `found`, and counts this power cycle in memory
 * that survives a loss of the supply. Returns 0, or 1 if the cycle cannot be counted; the ECU then has no key.
 */
int sw_board_authentication(sw_authentication *found);

/* Stores the freshness values of the newest accepted frames. Call it after every step: a frame whose value is not
 * stored could be replayed once after a restart.
 */
void sw_board_keep_freshness(const sw_ecu_state *state);
#endif

/* Reads the error counters. If the controller went bus-off, counts the event and restarts the controller. */
void sw_board_can_health(sw_bus_health *health);

#endif
