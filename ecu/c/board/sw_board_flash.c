/* A driver of the STM32H743's flash controller (RM0433, section 4): sectors of 128 KiB, words of 32 bytes. The driver
 * writes only the second bank. The program is in the first bank, so the core continues to run during a write. The core
 * stalls only if it reads the second bank during an erasure. The data cache must not hold data of the second bank.
 */
#include <stddef.h>

#include "sw_board.h"

#define FLASH(offset) SW_BOARD_REGISTER(SW_BOARD_FLASH + (offset))
#define KEYR 0x04u
#define CR 0x0cu
#define SR 0x10u
#define CCR 0x14u
#define CR_LOCK 1u
#define CR_PROGRAM 2u
#define CR_ERASE_SECTOR 4u
#define CR_64_BITS (3u << 4)
#define CR_START (1u << 7)
#define SR_AT_WORK 7u /* bits BSY, WBNE and QW, which are set while the controller works */
#define SR_DOUBLE_ERROR (1u << 26)
#define SR_ERRORS 0x0eee0000u
#define CORE_CONFIGURATION SW_BOARD_REGISTER(0xe000ed14u)
#define IGNORE_BUS_FAULTS (1u << 8)

/* Waits for the controller; if the controller hangs, the watchdog ends the wait. */
static void wait(void)
{
    while ((FLASH(SR) & SR_AT_WORK) != 0u && (FLASH(SR) & SR_ERRORS) == 0u) {
    }
}

static uint32_t begin(void)
{
    wait();
    FLASH(CCR) = SR_ERRORS;
    if ((FLASH(CR) & CR_LOCK) != 0u) {
        FLASH(KEYR) = 0x45670123u;
        FLASH(KEYR) = 0xcdef89abu;
    }
    return FLASH(CR) & CR_LOCK;
}

/* Ends an operation. Returns 1 if the controller reports an error. */
static int end(void)
{
    __asm__ volatile("dsb" ::: "memory");
    wait();
    const uint32_t errors = FLASH(SR) & SR_ERRORS;
    FLASH(CR) = CR_LOCK;
    return errors != 0u;
}

static int64_t begun_ns; /* time at which the latest erasure began */

static int erase(void *context, uint32_t sector)
{
    (void)context;
    if (sector >= SW_BOARD_FLASH_SECTORS || begin() != 0u) return 1;
    FLASH(CR) = CR_64_BITS | CR_ERASE_SECTOR | (sector << 8);
    FLASH(CR) = CR_64_BITS | CR_ERASE_SECTOR | (sector << 8) | CR_START;
    __asm__ volatile("dsb" ::: "memory");
    begun_ns = sw_board_now_ns();
    return 0;
}

static sw_flash_state erased(void *context)
{
    const uint32_t status = FLASH(SR);
    (void)context;
    if ((status & SR_AT_WORK) != 0u && (status & SR_ERRORS) == 0u) {
        return sw_board_now_ns() - begun_ns < SW_BOARD_ERASE_NS ? SW_FLASH_AT_WORK : SW_FLASH_FAILED;
    }
    FLASH(CR) = CR_LOCK;
    return (status & SR_ERRORS) != 0u ? SW_FLASH_FAILED : SW_FLASH_DONE;
}

static int program(void *context, uint32_t address, const uint8_t *word)
{
    (void)context;
    if (address >= SW_FLASH_SECTOR * SW_BOARD_FLASH_SECTORS || address % SW_FLASH_WORD != 0u || begin() != 0u) return 1;
    FLASH(CR) = CR_64_BITS | CR_PROGRAM;
    __asm__ volatile("dsb" ::: "memory"); /* the core does not order stores to registers and to memory */
    for (uint32_t i = 0; i < SW_FLASH_WORD; i += 4u) {
        const uint32_t part = word[i] | ((uint32_t)word[i + 1u] << 8) | ((uint32_t)word[i + 2u] << 16) |
                              ((uint32_t)word[i + 3u] << 24);
        SW_BOARD_REGISTER(SW_BOARD_FLASH_BANK + address + i) = part;
    }
    return end();
}

/* Reads bytes. A word with an uncorrectable error causes a bus fault, which FAULTMASK and BFHFNMIGN suppress. */
static int read(void *context, uint32_t address, uint8_t *data, uint32_t length)
{
    const uint32_t size = SW_FLASH_SECTOR * SW_BOARD_FLASH_SECTORS;
    (void)context;
    if (address > size || length > size - address) return 1;
    FLASH(CCR) = SR_DOUBLE_ERROR;
    const uint32_t configuration = CORE_CONFIGURATION;
    __asm__ volatile("cpsid f" ::: "memory");
    CORE_CONFIGURATION = configuration | IGNORE_BUS_FAULTS;
    __asm__ volatile("dsb\n isb" ::: "memory");
    const volatile uint8_t *const from = (const volatile uint8_t *)(uintptr_t)(SW_BOARD_FLASH_BANK + address);
    for (uint32_t i = 0; i < length; i++) data[i] = from[i];
    __asm__ volatile("dsb\n isb" ::: "memory");
    CORE_CONFIGURATION = configuration;
    __asm__ volatile("cpsie f" ::: "memory");
    return (FLASH(SR) & SR_DOUBLE_ERROR) != 0u;
}

const sw_flash sw_board_flash = {
    NULL, (const uint8_t *)(uintptr_t)SW_BOARD_FLASH_BANK, erase, erased, program, read,
};
