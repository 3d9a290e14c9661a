/* The ECU's side of UDS (ISO 14229-1): requests in, answers out, time as an argument. The twin of can_bridge/uds/server.py,
 * job.py, sessions.py and transfer.py.
 *
 * Every request is checked in the order of the standard's figures: is the service there, is it in this session, is the
 * length right, is the sub-function there and in this session, is the level unlocked, is it its turn; then the ECU behind
 * it may refuse for reasons of its own. One request is worked on at a time, in pieces, one for each sw_uds_tick.
 *
 * Answers are written into the queue of the node's sw_isotp.
 */
#ifndef SW_UDS_H
#define SW_UDS_H

#include <stdint.h>

#include "sw_answer.h"
#include "sw_uds_settings.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sw_node sw_node;

/* What a handler returns besides a negative response code (SW_NRC_). */
#define SW_UDS_DONE 0u /* the answer is positive */
#define SW_UDS_MORE 1u /* `work` of the server goes on with it, a piece a call */

/* Goes on with a request: a piece of it. */
typedef uint8_t (*sw_uds_work)(sw_node *node, sw_answer *answer);

#define SW_BLOCK_DIGEST_BYTES 32u

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
    uint8_t last_digest[SW_BLOCK_DIGEST_BYTES];
} sw_transfer;

typedef struct {
    uint8_t session;  /* SW_SESSION_ */
    uint8_t has_time; /* whether now_ns is one */
    uint8_t reset_is_due;
    uint8_t service;  /* that is worked on; 0: none */
    uint8_t is_silent; /* a tester wants no frames of the control; they are sent all the same while a jet can run */
    uint8_t is_quiet; /* the tester wants no positive answer to it */
    uint8_t is_functional; /* every ECU has the request: what others may serve is passed over in silence */
    uint8_t piece;    /* of it, for the work's own count */
    uint16_t waiting; /* bytes of a request that waits for the memory to be erased; 0: none does */
    int64_t now_ns;   /* a clock that goes back stands still here */
    int64_t heard_ns; /* since when the tester has been silent */
    int64_t pending_ns;
    uint8_t head[3]; /* of a routine's answer: sub-function and number */
    sw_uds_work work;
    sw_transfer transfer;
} sw_uds;

void sw_uds_init(sw_uds *uds);

/* Whether a request or a reset is under way: sw_uds_tick goes on with it. */
int sw_uds_is_busy(const sw_uds *uds);

/* At the beginning of each look at diagnosis: a session ends in which no tester was heard for S3. While a message is on its
 * way, in either direction, and while a request is worked on, the tester is there (ISO 14229-2).
 */
void sw_uds_look(sw_node *node, int64_t now_ns);

/* Takes a whole request of `length` bytes, 1 or more, perhaps one to every ECU, and does the first piece of it. One that
 * comes before a long answer to another one is on the bus is not begun: the tester has to send it again.
 */
void sw_uds_request(sw_node *node, int64_t now_ns, uint8_t *request, uint32_t length, int is_functional);

/* Goes on with what is under way: one piece of it, or the reset that was answered before. Call it at least every 20 ms
 * while the server is busy.
 */
void sw_uds_tick(sw_node *node, int64_t now_ns);

/* Whether what is worked on is still read where it came: in the message of the node's sw_isotp. */
int sw_uds_holds_message(const sw_uds *uds);

/* Whether what is worked on waits for the memory: a look every millisecond is enough. */
int sw_uds_waits(const sw_node *node);

/* Whether a security level is not the one that is unlocked; 0: no level is needed. */
int sw_uds_is_locked(const sw_node *node, uint8_t level);

/* --- sw_services.c: the services by their numbers --- */

/* In which sessions something is there, a bit each. */
#define SW_IN_DEFAULT (1u << SW_SESSION_DEFAULT)
#define SW_IN_PROGRAMMING (1u << SW_SESSION_PROGRAMMING)
#define SW_IN_EXTENDED (1u << SW_SESSION_EXTENDED)
#define SW_IN_ALL (SW_IN_DEFAULT | SW_IN_PROGRAMMING | SW_IN_EXTENDED)

/* `body` is what follows the service's number, without the bit that suppresses the answer; `answer` begins with the
 * number of the positive one.
 */
typedef struct {
    uint8_t service;
    uint8_t sessions;
    uint8_t has_sub_function;
    uint8_t writes; /* needs the flash memory: it waits while a sector is erased for later use */
    uint8_t (*handle)(sw_node *node, const uint8_t *body, uint32_t length, sw_answer *answer);
} sw_service;

/* The service of this number, or NULL. */
const sw_service *sw_service_of(uint8_t number);

/* A session begins, and whatever belonged to the one before ends. */
void sw_uds_change_session(sw_node *node, int64_t now_ns, uint8_t session);

#ifdef __cplusplus
}
#endif

#endif
