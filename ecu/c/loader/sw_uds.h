/* The ECU's side of UDS (ISO 14229-1): it processes requests and returns answers; the time is an argument. This file
 * corresponds to can_bridge/uds/server.py and under_way.py. The caller provides the table of services.
 *
 * Every request is checked in the order of the standard's figures: service, session, length, sub-function and its
 * session, security level, sequence. The function of the service may then refuse the request for further reasons.
 * Requests are processed one at a time and in parts: each sw_uds_tick executes one part.
 */
#ifndef SW_UDS_H
#define SW_UDS_H

#include <stdint.h>

#include "sw_access.h"
#include "sw_bytes.h"
#include "sw_isotp.h"
#include "sw_request.h"
#include "sw_store.h"

/* The data of the services. The server only passes a pointer to this data. */
typedef struct sw_services sw_services;

/* The sessions in which a service exists, one bit each. */
#define SW_IN_DEFAULT (1u << SW_SESSION_DEFAULT)
#define SW_IN_PROGRAMMING (1u << SW_SESSION_PROGRAMMING)
#define SW_IN_EXTENDED (1u << SW_SESSION_EXTENDED)
#define SW_IN_ALL (SW_IN_DEFAULT | SW_IN_PROGRAMMING | SW_IN_EXTENDED)

/* A service; `number` is the service identifier (SID). `body` has the request's bytes after the SID, with the
 * suppress-positive-response bit cleared. `answer` begins with the SID of the positive response. `handle` and `go_on`
 * return SW_UDS_DONE, SW_UDS_MORE, or a negative response code SW_NRC_.
 */
typedef struct {
    uint8_t number;
    uint8_t sessions;
    uint8_t has_sub_function;
    uint8_t writes; /* 1 if the service needs the flash memory; it then waits until a running erasure has ended */
    uint8_t (*handle)(sw_services *services, const uint8_t *body, uint32_t length, sw_answer *answer);
    uint8_t (*go_on)(sw_services *services, sw_answer *answer); /* executes a further part; NULL if there is none */
} sw_service;

typedef struct {
    const sw_service *rows;
    uint32_t count;
    void (*end_session)(sw_services *services, uint8_t next); /* ends the session's activities */
} sw_service_table;

typedef struct {
    const sw_service_table *table;
    sw_services *services;
    sw_isotp *isotp; /* its queue receives the answers */
    sw_store *store;
    const sw_service *under_way; /* the service in progress, or NULL */
    uint8_t session;  /* SW_SESSION_ */
    uint8_t has_time; /* whether now_ns is valid */
    uint8_t reset_is_due;
    uint8_t wants_reset; /* whether the ECU must be reset */
    uint8_t is_silent; /* a tester has stopped JetCommand and EcuStatus, which are still sent while a jet can run */
    uint8_t is_quiet;  /* the tester has suppressed the positive response */
    uint8_t is_functional; /* the request goes to every ECU: refusals such as "not supported" are not sent */
    uint16_t waiting;      /* length in bytes of a request that waits for the end of an erasure; 0 if none waits */
    sw_access access;
    int64_t now_ns;   /* latest time; it never decreases, even if the clock goes back */
    int64_t heard_ns; /* time at which the tester was last heard */
    int64_t pending_ns;
} sw_uds;

/* Returns whether a request or a reset is in progress, so that sw_uds_tick has to be called. */
int sw_uds_is_busy(const sw_uds *uds);

/* Ends a session in which no tester was heard for the time S3. Call it in every call of diagnosis, before the requests.
 * The tester counts as present while a message is transferred in either direction, or while a request is in progress
 * (ISO 14229-2).
 */
void sw_uds_look(sw_uds *uds, int64_t now_ns);

/* Processes a complete physical or functional request of at least 1 byte, and executes its first part. A request is
 * refused while another request is in progress, or while a long answer is being sent; the tester has to repeat it.
 */
void sw_uds_request(sw_uds *uds, int64_t now_ns, uint8_t *request, uint32_t length, int is_functional);

/* Executes a part of the request in progress, or requests a due reset. Call it at least every 20 ms while busy. */
void sw_uds_tick(sw_uds *uds, int64_t now_ns);

/* Returns whether the request in progress still needs the bytes in `isotp->message`. */
int sw_uds_holds_message(const sw_uds *uds);

/* Returns whether the request in progress waits for the flash memory: one call per millisecond is then enough. */
int sw_uds_waits(const sw_uds *uds);

/* Returns whether a security level is locked; level 0 is never locked. */
int sw_uds_is_locked(const sw_uds *uds, uint8_t level);

/* Begins a session, and ends the activities of the previous session. */
void sw_uds_change_session(sw_uds *uds, uint8_t session);

#endif
