/* The ECU in a vehicle: it boots a release from its flash memory, controls the jets, and can be flashed and calibrated.
 * This file corresponds to ecu/flashable.
 *
 * The code is freestanding C99, without allocation, recursion or static state: all memory is in the caller's sw_node.
 *
 *     static sw_node node;
 *     static uint8_t message[SW_ISOTP_MOST];
 *     sw_node_init(&node, &equipment, &flash, message);
 *     every control period:
 *         count = sw_node_step(&node, now_ns, frames_in, n, frames_out);   send frames_out[0 .. count - 1]
 *     in between, if there is time, and a frame for diagnosis has arrived or sw_node_is_busy:
 *         count = sw_node_service(&node, now_ns, frames_in, n, room, frames_out);
 *     whenever all frames have been sent and sw_node_wants_reset: reset the microcontroller.
 *
 * An image runs in place in the flash, or from a copy (sw_equipment). The copy is needed if the flash cannot be read
 * while one of its sectors is erased. An erasure takes a second on some chips, and a control period without the copy
 * would have to wait. A transfer may overwrite the image that runs on trial. From its announcement until a reset, the
 * counts of periods and frames are constant, JetCommand has no valid PressureCounter, and the self-test is refused.
 *
 * A call executes at most one part of long work (hash, signature, erasure). A call for a node must not interrupt
 * another call for the same node.
 */
#ifndef SW_NODE_H
#define SW_NODE_H

#include <stdint.h>

#include "sw_ecu.h"
#include "sw_isotp.h"
#include "sw_services.h"
#include "sw_store.h"
#include "sw_xcp.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SW_NODE_FRAMES (SW_FRAMES_OUT + SW_ISOTP_BURST) /* largest number of frames that a step returns */

typedef struct {
    sw_store store;
    sw_isotp isotp;
    sw_services services;
#if SW_XCP
    sw_xcp xcp;
#endif
    uint32_t bundle_hash; /* short hash of the booted release; 0 if none is booted */
    uint8_t is_sending;
    uint8_t is_full;   /* whether frames wait because the CAN controller had no room */
    uint8_t has_begun; /* whether sw_node_service has run since power-on; begun_ns is the time of the first run */
    int64_t begun_ns;
    sw_ecu ecu; /* last member; the caller writes `ecu.surroundings.health`, as for sw_ecu_step */
} sw_node;

/* Boots the release in the flash memory, at power-on. `message` has SW_ISOTP_MOST bytes. All arguments must stay valid
 * as long as the node is used. Returns the result of sw_ecu_init.
 */
int sw_node_init(sw_node *node, const sw_equipment *equipment, const sw_flash *flash, uint8_t *message);

/* Runs one control period and one call of diagnosis. frames_in is as for sw_ecu_step, but must not overlap frames_out.
 * Returns the number of frames to send.
 */
int sw_node_step(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count,
                 sw_frame frames_out[SW_NODE_FRAMES]);

/* The two parts of sw_node_step, for callers that run them separately. sw_node_service processes at most SW_MOST_FRAMES
 * frames per call. It returns at most `room` frames, the number of free places in the CAN controller. Call it
 * again a millisecond later for the remaining frames.
 */
int sw_node_control(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count,
                    sw_frame frames_out[SW_FRAMES_OUT]);
int sw_node_service(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count, int room,
                    sw_frame frames_out[SW_ISOTP_BURST]);

/* Returns whether a frame is for diagnosis, that is, from a tester or from a calibration tool. */
int sw_node_is_request(const sw_frame *frame);

/* Returns whether sw_node_service has work to do even if no further frame arrives. */
int sw_node_is_busy(const sw_node *node);

/* Returns whether this work waits for the flash or the CAN bus; one call per millisecond is then enough. */
int sw_node_waits(const sw_node *node);

int sw_node_wants_reset(const sw_node *node);

/* Returns whether the jets stay shut until a reset: an image is being written, or a reset was requested. */
int sw_node_needs_reset(const sw_node *node);

/* Return sizeof(sw_node), and the size of sw_node without its sw_ecu, for callers in other languages. */
size_t sw_node_bytes(void);
size_t sw_node_loader_bytes(void);

#ifdef __cplusplus
}
#endif

#endif
