/* A node with a flash memory in RAM, and what a test needs to drive it. */
#ifndef NODE_HOST_H
#define NODE_HOST_H

#include "sw_node.h"

#define HOST_TEXT 64
#define HOST_COPY 8192 /* bytes of an image that run from a copy; the longest ones have more, which nothing reads */

typedef struct {
    sw_node node;
    sw_equipment equipment;
    sw_rules rules;
    sw_flash flash;
    uint8_t access_key[SW_AES_BYTES];
    char hardware[HOST_TEXT], serial[HOST_TEXT], software[HOST_TEXT];
    uint64_t seeds;  /* given so far */
    uint32_t writes; /* erasures and words programmed */
    uint32_t worst;  /* of them in one call of the service */
    uint32_t slow, looks; /* at an erasure until it has ended: of each, and of the one at work */
    uint8_t has_begun; /* with authentication: was powered on before */
    int room; /* frames that diagnosis may send in a call */
    int fails;       /* 1: the flash memory takes nothing; 2: random bytes are zeros; 3: there are none; 4..6: plans are too great; 7: NaN */
    uint8_t message[SW_ISOTP_MOST + 1];
    uint8_t copy_room[HOST_COPY + 64];
    uint8_t memory_room[SW_FLASH_BYTES + 64];
} host;

size_t host_bytes(void);
uint8_t *host_memory(host *of);

/* A flash memory that is blank, and what the ECU was given; call host_power_on then. */
void host_init(host *of, const sw_rules *rules, const uint8_t *access_key, const char *hardware, const char *serial,
               const char *software);
void host_power_on(host *of);
/* A key list, and a release that is confirmed; without one if `length` is 0. Returns an sw_store_result. */
int host_provision(host *of, const uint8_t *keys, uint32_t key_bytes, const uint8_t *image, uint32_t length,
                   const uint8_t *sha256);
int host_control(host *of, int64_t now_ns, const sw_frame *frames, int count, sw_frame *sent);
int host_service(host *of, int64_t now_ns, const sw_frame *frames, int count, sw_frame *sent);
/* 0: busy, 1: wants_reset, 2: needs_reset, 3: session, 4: unlocked, 5: boot reason, 6: running slot, 7: worst writes,
 * 8: waits, 9: drives_jets, 10: writes so far
 */
uint32_t host_fact(const host *of, int which);
void host_fail(host *of, int what);
/* From now on: looks at an erasure, and frames of diagnosis in a call. */
void host_set(host *of, uint32_t slow, int room);
void host_dump(void);

#endif
