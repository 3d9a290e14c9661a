/* The bus key. Production writes the key into this file if SW_SECOC is 1. Without a key the ECU sends nothing. */
#ifndef SW_BOARD_BUS_KEY_H
#define SW_BOARD_BUS_KEY_H

#define SW_BOARD_BUS_KEY {0}

#endif
