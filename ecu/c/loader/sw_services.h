/* What the UDS server serves of an ECU: the parts behind the services, and the table of these. The twin of
 * can_bridge/uds/permissions.py and transfer.py, and of the handlers in server.py.
 */
#ifndef SW_SERVICES_H
#define SW_SERVICES_H

#include <stdint.h>

#include "sw_calibrating.h"
#include "sw_faults.h"
#include "sw_programming.h"
#include "sw_uds.h"

/* What an ECU is given at production; no reset changes it, and it outlives the node. */
typedef struct {
    const sw_rules *rules;     /* by which images and key lists are judged */
    const uint8_t *access_key; /* shared with the tester, SW_AES_BYTES */
    const char *hardware;      /* its name; UTF-8, as the following */
    const char *serial;        /* number of this ECU */
    const char *software;      /* version of the loader */
    sw_random random;
    void *context; /* for `random` */
    uint8_t *image; /* for a copy of the image that runs, at a multiple of 64 bytes; NULL: it runs in the flash */
    uint32_t image_bytes; /* of the copy: SW_IMAGE_HEADER + sizeof(sw_payload) */
} sw_equipment;

typedef enum { SW_NO_TRANSFER, SW_TRANSFER_OPEN, SW_TRANSFER_CLOSED } sw_transfer_state;

/* A download that was asked for. The block that was taken last is remembered by its SHA-256, to acknowledge it again. */
typedef struct {
    uint8_t state;    /* sw_transfer_state */
    uint8_t expected; /* counter of the next block */
    uint8_t has_last;
    uint8_t last; /* counter of the block that was taken last */
    uint32_t offset;
    uint32_t length;
    uint32_t missing;
    uint8_t last_digest[SW_SHA256_BYTES];
} sw_transfer;

struct sw_services {
    const sw_equipment *equipment;
    sw_programming programming; /* beside a pointer: no byte is lost to alignment */
    sw_vehicle_request request;
    sw_uds uds;
    sw_calibrating calibrating;
    sw_faults faults;
    sw_transfer transfer;
};

/* Connects the parts: at power-on, in memory of zeros. What is given outlives them. */
void sw_services_init(sw_services *services, const sw_equipment *equipment, sw_store *store, sw_isotp *isotp,
                      sw_ecu *ecu);

#endif
