/* The ECU's side of UDS (ISO 14229-1): requests in, answers out, time as an argument. The twin of can_bridge/uds/server.py,
 * job.py and sessions.py. What is served stands in a table that it is given.
 *
 * Every request is checked in the order of the standard's figures: is the service there, is it in this session, is the
 * length right, is the sub-function there and in this session, is the level unlocked, is it its turn; then the ECU behind
 * it may refuse for reasons of its own. One request is worked on at a time, in pieces, one for each sw_uds_tick.
 */
#ifndef SW_UDS_H
#define SW_UDS_H

#include <stdint.h>

#include "sw_access.h"
#include "sw_bytes.h"
#include "sw_isotp.h"
#include "sw_request.h"
#include "sw_store.h"

/* Whatever the services work on; the server only hands it to them. */
typedef struct sw_services sw_services;

/* The sessions in which something is there, a bit each. */
#define SW_IN_DEFAULT (1u << SW_SESSION_DEFAULT)
#define SW_IN_PROGRAMMING (1u << SW_SESSION_PROGRAMMING)
#define SW_IN_EXTENDED (1u << SW_SESSION_EXTENDED)
#define SW_IN_ALL (SW_IN_DEFAULT | SW_IN_PROGRAMMING | SW_IN_EXTENDED)

/* `body` is what follows the service's number, without the bit that suppresses the answer; `answer` begins with the
 * number of the positive one. Both functions return SW_UDS_DONE, SW_UDS_MORE or the SW_NRC_ of the refusal.
 */
typedef struct {
    uint8_t number;
    uint8_t sessions;
    uint8_t has_sub_function;
    uint8_t writes; /* needs the flash memory: it waits while a sector is erased for later use */
    uint8_t (*handle)(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer);
    uint8_t (*go_on)(sw_services *services, sw_answer *answer); /* a further piece; NULL where the first is all */
} sw_service;

typedef struct {
    const sw_service *rows;
    uint32_t count;
    void (*end_session)(sw_services *services, uint8_t next); /* ends what belonged to the session */
} sw_service_table;

typedef struct {
    const sw_service_table *table;
    sw_services *services;
    sw_isotp *isotp; /* answers are written into its queue */
    sw_store *store;
    const sw_service *under_way; /* the service that is worked on, or NULL */
    uint8_t session;  /* SW_SESSION_ */
    uint8_t has_time; /* whether now_ns is one */
    uint8_t reset_is_due;
    uint8_t wants_reset; /* the ECU must be reset */
    uint8_t is_silent; /* a tester wants no frames of the control; they are sent all the same while a jet can run */
    uint8_t is_quiet; /* the tester wants no positive answer to it */
    uint8_t is_functional; /* every ECU has the request: what others may serve is passed over in silence */
    uint16_t waiting; /* bytes of a request that waits for the memory to be erased; 0: none does */
    sw_access access;
    int64_t now_ns;   /* a clock that goes back stands still here */
    int64_t heard_ns; /* since when the tester has been silent */
    int64_t pending_ns;
} sw_uds;

/* Whether a request or a reset is under way: sw_uds_tick goes on with it. */
int sw_uds_is_busy(const sw_uds *uds);

/* Ends a session in which no tester was heard for S3: at the beginning of each look at diagnosis. While a message is on its
 * way, in either direction, and while a request is worked on, the tester is there (ISO 14229-2).
 */
void sw_uds_look(sw_uds *uds, int64_t now_ns);

/* Takes a whole request of `length` bytes, 1 or more, perhaps one to every ECU, and does the first piece of it. One that
 * comes before a long answer to another one is on the bus is not begun: the tester has to send it again.
 */
void sw_uds_request(sw_uds *uds, int64_t now_ns, uint8_t *request, uint32_t length, int is_functional);

/* Goes on with what is under way: one piece of it, or the reset that was answered before. Call it at least every 20 ms
 * while the server is busy.
 */
void sw_uds_tick(sw_uds *uds, int64_t now_ns);

/* Whether what is worked on is still read where it came: in the message of the sw_isotp. */
int sw_uds_holds_message(const sw_uds *uds);

/* Whether what is worked on waits for the memory: a look every millisecond is enough. */
int sw_uds_waits(const sw_uds *uds);

/* Whether a security level is not the one that is unlocked; 0: no level is needed. */
int sw_uds_is_locked(const sw_uds *uds, uint8_t level);

/* Begins a session, and ends whatever belonged to the one before. */
void sw_uds_change_session(sw_uds *uds, uint8_t session);

#endif
