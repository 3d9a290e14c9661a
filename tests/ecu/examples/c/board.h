#ifndef BOARD_H
#define BOARD_H
#include <stdint.h>
int64_t board_ns(void);
void board_wait(int64_t until_ns, void (*arrived)(void));
uint32_t board_id(void);
void board_data(uint8_t *data);
void board_print(uint32_t id, const uint8_t *data, int length);
#endif
