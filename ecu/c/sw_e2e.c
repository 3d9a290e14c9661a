/* The AUTOSAR end-to-end protection (PRS_E2EProtocol) of the messages in use. CAN FD uses profile 5. Classic CAN uses
 * profile 2, with 16 equal data IDs for each message.
 *
 * The CRCs are computed half byte by half byte, so that the table has only 16 entries. No branch depends on the data.
 */
#include "sw_ecu_parts.h"

#if SW_E2E_PROFILE == 5

#define HEADER 3 /* header: CRC-16 with its low byte first, then the counter */
#define COUNTER 2

/* CRC-16 of the half bytes 0 to 15: polynomial 0x1021, not reflected. */
static const uint16_t table[16] = {
    0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50a5, 0x60c6, 0x70e7,
    0x8108, 0x9129, 0xa14a, 0xb16b, 0xc18c, 0xd1ad, 0xe1ce, 0xf1ef,
};

static uint32_t with_byte(uint32_t crc, uint32_t byte)
{
    const uint32_t half = ((crc << 4) & 0xffffu) ^ table[(crc >> 12) ^ (byte >> 4)];
    return ((half << 4) & 0xffffu) ^ table[(half >> 12) ^ (byte & 0x0fu)];
}

/* Computes the CRC over the counter, the data, and the data ID with its low byte first. The data ID is not sent. */
static uint32_t crc_of(const uint8_t *data, int length, uint16_t data_id)
{
    uint32_t crc = 0xffffu;
    for (int i = COUNTER; i < length; i++) crc = with_byte(crc, data[i]);
    crc = with_byte(crc, (uint32_t)data_id & 0xffu);
    return with_byte(crc, (uint32_t)data_id >> 8);
}

static uint32_t crc_sent(const uint8_t *data) { return (uint32_t)data[0] | ((uint32_t)data[1] << 8); }

void sw_e2e_protect(uint8_t *data, int length, uint16_t data_id, uint8_t counter)
{
    data[COUNTER] = counter;
    const uint32_t crc = crc_of(data, length, data_id);
    data[0] = (uint8_t)(crc & 0xffu);
    data[1] = (uint8_t)(crc >> 8);
}

uint8_t sw_e2e_counter(const uint8_t *data) { return data[COUNTER]; }

#elif SW_E2E_PROFILE == 2

#define HEADER 2 /* header: CRC-8, then a byte: counter in the lower half, bits of the message in the upper half */
#define COUNTER 1

/* CRC-8 of the half bytes 0 to 15: polynomial 0x2F, not reflected. */
static const uint8_t table[16] = {
    0x00, 0x2f, 0x5e, 0x71, 0xbc, 0x93, 0xe2, 0xcd,
    0x57, 0x78, 0x09, 0x26, 0xeb, 0xc4, 0xb5, 0x9a,
};

static uint32_t with_byte(uint32_t crc, uint32_t byte)
{
    const uint32_t half = ((crc << 4) & 0xffu) ^ table[(crc >> 4) ^ (byte >> 4)];
    return ((half << 4) & 0xffu) ^ table[(half >> 4) ^ (byte & 0x0fu)];
}

/* Computes the CRC over everything after the CRC, and over the data ID. The data ID is not sent. */
static uint32_t crc_of(const uint8_t *data, int length, uint16_t data_id)
{
    uint32_t crc = 0xffu;
    for (int i = COUNTER; i < length; i++) crc = with_byte(crc, data[i]);
    return with_byte(crc, (uint32_t)data_id & 0xffu) ^ 0xffu;
}

static uint32_t crc_sent(const uint8_t *data) { return data[0]; }

void sw_e2e_protect(uint8_t *data, int length, uint16_t data_id, uint8_t counter)
{
    data[COUNTER] = (uint8_t)((data[COUNTER] & 0xf0u) | (counter & 0x0fu));
    data[0] = (uint8_t)crc_of(data, length, data_id);
}

uint8_t sw_e2e_counter(const uint8_t *data) { return (uint8_t)(data[COUNTER] & 0x0fu); }

#else
#error "the E2E profile of the messages must be 5 or 2"
#endif

int sw_e2e_check(const uint8_t *data, int length, uint16_t data_id)
{
    return length >= HEADER && crc_of(data, length, data_id) == crc_sent(data);
}
