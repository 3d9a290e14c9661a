/* The services of the UDS server: the parts of the ECU that the services use, and the table of services. This file
 * corresponds to can_bridge/uds/services.py, to Download in under_way.py, and to the handlers in server.py.
 */
#ifndef SW_SERVICES_H
#define SW_SERVICES_H

#include <stdint.h>

#include "sw_calibrating.h"
#include "sw_faults.h"
#include "sw_programming.h"
#include "sw_uds.h"

/* An ECU's production data, random source and memory for an image. All must stay valid as long as the node is used. */
typedef struct {
    const sw_rules *rules;     /* rules by which images and key lists are judged */
    const uint8_t *access_key; /* secret shared with the tester, of SW_AES_BYTES bytes */
    const char *hardware;      /* name of the hardware; UTF-8, like the following texts */
    const char *serial;        /* serial number of this ECU */
    const char *software;      /* version of the loader */
    sw_random random;
    void *context; /* argument of `random` */
    uint8_t *image; /* memory for a copy of the running image, aligned to 64 bytes; NULL: the image runs in flash */
    uint32_t image_bytes; /* size of the copy: SW_IMAGE_HEADER + sizeof(sw_payload) */
} sw_equipment;

typedef enum { SW_NO_TRANSFER, SW_TRANSFER_OPEN, SW_TRANSFER_CLOSED } sw_transfer_state;

/* A requested download. The SHA-256 of the last block serves to recognise a repeated last block. */
typedef struct {
    uint8_t state;    /* sw_transfer_state */
    uint8_t expected; /* counter of the next block */
    uint8_t has_last;
    uint8_t last; /* counter of the last accepted block */
    uint32_t offset;
    uint32_t length;
    uint32_t missing;
    uint8_t last_digest[SW_SHA256_BYTES];
} sw_transfer;

struct sw_services {
    const sw_equipment *equipment;
    sw_programming programming; /* placed after a pointer to avoid padding for alignment */
    sw_vehicle_request request;
    sw_uds uds;
    sw_calibrating calibrating;
    sw_faults faults;
    sw_transfer transfer;
};

/* Connects the parts at power-on. `services` must be zero before the call. The arguments must stay valid during use. */
void sw_services_init(sw_services *services, const sw_equipment *equipment, sw_store *store, sw_isotp *isotp,
                      sw_ecu *ecu);

#endif
