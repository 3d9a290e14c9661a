/* The key of the bus, written at production where SW_SECOC is 1. This one is none: the ECU then sends nothing. */
#ifndef SW_BOARD_BUS_KEY_H
#define SW_BOARD_BUS_KEY_H

#define SW_BOARD_BUS_KEY {0}

#endif
