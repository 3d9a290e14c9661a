#include "sw_board.h"
int test_erase(uint32_t sector);
int test_program(uint32_t address);
int test_read(uint32_t address);
uint8_t test_data[64];
sw_ecu *const sw_board_ecu = 0;
extern void sw_board_main(void);
int test_erase(uint32_t sector) { return sw_board_flash.erase(0, sector); }
int test_erased(void);
int test_erased(void) { return (int)sw_board_flash.erased(0); }
int test_program(uint32_t address) { return sw_board_flash.program(0, address, test_data); }
int test_read(uint32_t address) { return sw_board_flash.read(0, address, test_data, 64); }
int test_word(uint32_t address);
int test_word(uint32_t address) { return *(const volatile int *)(uintptr_t)address; }
int test_store(uint32_t address);
int test_store(uint32_t address) { SW_BOARD_REGISTER(address) = 1u; return 0; }
int test_byte(uint32_t address);
int test_byte(uint32_t address) { return *(const volatile uint8_t *)(uintptr_t)address; }
int test_random(void);
int test_random(void) { return (int)sw_board_random(test_data); }
int test_reset(void);
int test_reset(void) { sw_board_reset(); return 0; }
void sw_board_main(void) { for (;;) sw_board_sleep(0); }
