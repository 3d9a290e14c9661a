/* The data that a board receives at production. If this file is not changed, the firmware has no loader, and runs the
 * parameters that are compiled in.
 *
 * If SW_BOARD_LOADER is 1, the board runs the release in its flash, and can be flashed and calibrated. It then needs
 *     SW_BOARD_ROOT        the Ed25519 key that signs key lists, 32 bytes in braces
 *     SW_BOARD_ACCESS_KEY  the key of security access, 16 bytes in braces
 *     SW_BOARD_VEHICLE     bytes 148 to 191 of the header of every image for this vehicle, in braces
 *     SW_BOARD_HARDWARE, SW_BOARD_SERIAL, SW_BOARD_SOFTWARE  strings in quotes
 */
#ifndef SW_BOARD_EQUIPMENT_H
#define SW_BOARD_EQUIPMENT_H

#define SW_BOARD_LOADER 0

#endif
