/* The ECU as a vehicle runs it: it boots a release from its flash memory, controls, and can be flashed and calibrated. The
 * twin of ecu/flashable.
 *
 * Freestanding C99. No allocation, no recursion, no static state: everything stands in the caller's sw_node.
 *
 *     static sw_node node;
 *     static uint8_t message[SW_ISOTP_MOST];
 *     sw_node_init(&node, &equipment, &flash, message);
 *     every control period:
 *         count = sw_node_step(&node, now_ns, frames_in, n, frames_out);   send frames_out[0 .. count - 1]
 *     in between, whenever there is time and a frame for diagnosis or sw_node_is_busy:
 *         count = sw_node_service(&node, now_ns, frames_in, n, room, frames_out);
 *     whenever what was sent is on the bus and sw_node_wants_reset: reset the microcontroller.
 *
 * An image runs where it stands in the flash, or from a copy (sw_equipment). Flash memory that cannot be read while a
 * sector of it is erased, a second on some chips, needs the copy: else a control period waits as long. A transfer may
 * replace the very image that runs on trial: from its announcement on, which a reset alone leads out of, the ECU sends the
 * counts and the pressure counter as they stood, and refuses the self-test.
 *
 * A call does at most one piece of long work. No call may interrupt another one of the same node.
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

#define SW_NODE_FRAMES (SW_FRAMES_OUT + SW_ISOTP_BURST) /* that a step sends at most */

typedef struct {
    sw_store store;
    sw_isotp isotp;
    sw_services services;
#if SW_XCP
    sw_xcp xcp;
#endif
    uint32_t bundle_hash; /* of the release that was booted; 0 without one */
    uint8_t is_sending;
    uint8_t is_full;   /* whether more might be sent than there was room for */
    uint8_t has_begun; /* whether diagnosis was looked at since power-on, at begun_ns first */
    int64_t begun_ns;
    sw_ecu ecu; /* last; the caller writes `ecu.surroundings.health` as for sw_ecu_step */
} sw_node;

/* Power-on: boots the flash memory's release. `message` has SW_ISOTP_MOST bytes; all that is given outlives the node.
 * Returns as sw_ecu_init.
 */
int sw_node_init(sw_node *node, const sw_equipment *equipment, const sw_flash *flash, uint8_t *message);

/* One control period and one look at diagnosis; frames_in as for sw_ecu_step, and not the memory of frames_out. Returns
 * how many frames there are to be sent.
 */
int sw_node_step(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count,
                 sw_frame frames_out[SW_NODE_FRAMES]);

/* The two parts of it, for whoever runs them apart. Of the frames of a call diagnosis looks at SW_MOST_FRAMES. It sends
 * no more than there is `room` for, in a CAN controller's memory; what is left comes with a later call, for which a
 * millisecond is early enough.
 */
int sw_node_control(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count,
                    sw_frame frames_out[SW_FRAMES_OUT]);
int sw_node_service(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count, int room,
                    sw_frame frames_out[SW_ISOTP_BURST]);

/* Whether a frame is for diagnosis: a tester's, or a calibration tool's. */
int sw_node_is_request(const sw_frame *frame);

/* Whether sw_node_service has something to do without another frame. */
int sw_node_is_busy(const sw_node *node);

/* Whether that is to wait, for the flash memory or for frames to leave: then a look every millisecond is enough. */
int sw_node_waits(const sw_node *node);

int sw_node_wants_reset(const sw_node *node);

/* Whether only a reset leads out of the shut jets: an image is being written, or a reset was asked for. */
int sw_node_needs_reset(const sw_node *node);

/* sizeof(sw_node), and that without its sw_ecu, for callers in other languages. */
size_t sw_node_bytes(void);
size_t sw_node_loader_bytes(void);

#ifdef __cplusplus
}
#endif

#endif
