/* The bus key, which production writes here if SW_SECOC is 1. This file has no key: the ECU then sends nothing. */
#ifndef SW_BOARD_BUS_KEY_H
#define SW_BOARD_BUS_KEY_H

#define SW_BOARD_BUS_KEY {0}

#endif
