/* The data that a board receives at production, in one file. With this file as it is, the firmware has no loader and
 * runs the parameters that are compiled in.
 *
 * With SW_BOARD_LOADER 1 the board runs the release in its flash, can be flashed and calibrated, and needs
 *     SW_BOARD_ROOT        the Ed25519 key that signs key lists, 32 bytes in braces
 *     SW_BOARD_ACCESS_KEY  of security access, 16 bytes in braces
 *     SW_BOARD_VEHICLE     bytes 148 to 191 of the header of every image that fits, in braces
 *     SW_BOARD_HARDWARE, SW_BOARD_SERIAL, SW_BOARD_SOFTWARE  texts in quotes
 */
#ifndef SW_BOARD_EQUIPMENT_H
#define SW_BOARD_EQUIPMENT_H

#define SW_BOARD_LOADER 0

#endif
