/* A firmware's start: mcu_reset calls mcu_begin once memory is as the program needs it. */
#ifndef MCU_START_H
#define MCU_START_H

void mcu_reset(void);
void mcu_begin(void);

#endif
