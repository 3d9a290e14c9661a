/* The control and the diagnosis of one ECU, from a boot to the next reset. */
#include "sw_node.h"

#include <stddef.h>

#include "sw_ecu_parts.h"
#include "sw_image.h"

/* --- Boot --- */

/* Returns whether this build can run the image. */
static int opens(const uint8_t *image)
{
    sw_numbers numbers;
    return sw_image_open(image, &numbers) == SW_IMAGE_OK;
}

/* Returns the booted image in the flash, or a copy made in `equipment->image`; NULL if there is no readable image. */
static const uint8_t *image_of(const sw_node *node)
{
    const sw_store *store = &node->store;
    const sw_equipment *equipment = node->services.equipment;
    if (store->running == SW_NO_SLOT || equipment->image == NULL) return sw_store_image(store);
    const uint32_t length = store->state.slots[store->running].length;
    const uint32_t count = length < equipment->image_bytes ? length : equipment->image_bytes;
    return sw_store_read_image(store, equipment->image, count) == 0 ? equipment->image : NULL;
}

/* Starts the ECU of the booted image; without an image, the jets of this ECU stay shut. */
static void start_ecu(sw_node *node)
{
    const uint8_t *image = image_of(node);
    sw_numbers numbers;
    if (image != NULL && sw_image_open(image, &numbers) == SW_IMAGE_OK) {
        (void)sw_ecu_init_of(&node->ecu, &numbers);
        node->bundle_hash = numbers.release->bundle_hash;
        sw_calibrating_restore(&node->services.calibrating);
    } else {
        node->ecu.surroundings.fault = SW_REASON_NONE;
        node->ecu.state.fail_safe.mode = SW_FAULT;
    }
}

int sw_node_init(sw_node *node, const sw_equipment *equipment, const sw_flash *flash, uint8_t *message)
{
    sw_bytes_fill((uint8_t *)node, 0, sizeof *node);
    sw_isotp_init(&node->isotp, message);
    sw_services_init(&node->services, equipment, &node->store, &node->isotp, &node->ecu);
#if SW_XCP
    sw_xcp_init(&node->xcp, &node->services.calibrating, equipment->access_key, equipment->random, equipment->context);
#endif
    sw_store_open(&node->store, flash, equipment->rules, opens);
    sw_store_boot(&node->store);
    sw_faults_open(&node->services.faults);
    start_ecu(node);
    node->store.records.limit = SW_RECORDS_MOVE;
    return node->ecu.unfit != SW_REASON_NONE ? (int)node->ecu.unfit : (int)sw_inexact();
}

/* --- Control --- */

static int64_t clipped(int64_t now_ns)
{
    if (now_ns < 0) return 0;
    return now_ns < SW_LATEST_NS ? now_ns : SW_LATEST_NS;
}

/* Runs a control period while no release is booted, or while the booted release is overwritten. Does not read a
 * release; shuts the jets, sends the reason and advances the message counters. Corresponds to ecu/shut_ecu.py.
 */
static int shut_step(sw_node *node, int64_t now_ns, sw_frame frames_out[SW_FRAMES_OUT])
{
    sw_ecu_state *state = &node->ecu.state;
    sw_jet_command command = {0};
    const int updating = node->ecu.surroundings.updating; /* once true, `updating` stays true until a reset */
    state->fail_safe.mode = updating ? SW_UPDATE : SW_FAULT;
    state->fail_safe.reason = updating ? SW_REASON_UPDATING : SW_REASON_NO_RELEASE;
    state->health = node->ecu.surroundings.health;
    state->sensors.set_aside = -1;
    command.mode = sw_mode_on_wire(state->fail_safe.mode);
    return sw_write_frames(state, &command, node->bundle_hash, now_ns, frames_out SW_BY_KEY(&node->ecu.secoc));
}

int sw_node_control(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count,
                    sw_frame frames_out[SW_FRAMES_OUT])
{
    sw_ecu *ecu = &node->ecu;
    sw_services *services = &node->services;
    sw_vehicle_request *request = &services->request;
    const int has_release = sw_programming_has_release(&services->programming);
    const uint32_t missed = ecu->state.missed;
    const int drove = (int)request->drives_jets;
    int sent;
    sw_faults_before(&services->faults);
    /* The release that boots next cannot know whether the jets run, so the jets are shut before the reset. */
    ecu->surroundings.fault = services->uds.wants_reset ? SW_REASON_UPDATING : SW_REASON_NONE;
    ecu->surroundings.updating = services->programming.is_updating;
    if (has_release) {
        sw_calibrating_hand_over(&services->calibrating);
        sent = sw_ecu_step(ecu, now_ns, frames_in, count, frames_out);
#if SW_XCP
        sw_daq_sample(&node->xcp.daq, ecu, sw_mode_on_wire(ecu->state.fail_safe.mode));
#endif
    } else {
        sent = shut_step(node, now_ns, frames_out);
    }
    sw_faults_after(&services->faults, clipped(now_ns));
    request->drives_jets = (uint8_t)sw_drives_jets(ecu->state.fail_safe.mode);
    if (has_release && ecu->state.missed == missed && ecu->state.fail_safe.enable_request) {
        request->has_asked = 1;
        request->asked_ns = clipped(now_ns);
    }
    /* The first command with shut jets is sent even if sending is disabled, so that the vehicle shuts the jets. */
    return services->uds.is_silent && !drove && !request->drives_jets ? 0 : sent;
}

/* --- Diagnosis --- */

/* Processes at most SW_ISOTP_QUEUE requests; returns their number. If answers fill the queue, requests are lost. */
static uint32_t take_requests(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count)
{
    uint8_t single[SW_FRAME_BYTES];
    uint32_t requests = 0;
    for (int i = 0; i < count; i++) {
        if (!sw_isotp_is_request(&frames_in[i])) continue;
        node->isotp.is_held = (uint8_t)sw_uds_holds_message(&node->services.uds);
        const uint32_t functional = sw_isotp_functional(&frames_in[i], single);
        const uint32_t length =
            functional > 0u ? functional : sw_isotp_receive(&node->isotp, now_ns, &frames_in[i], single);
        if (length == 0u || requests == SW_ISOTP_QUEUE) continue;
        requests++;
        if (!sw_isotp_is_full(&node->isotp)) {
            sw_uds_request(&node->services.uds, now_ns, functional > 0u ? single : node->isotp.whole, length,
                           functional > 0u);
        }
    }
    return requests;
}

/* Sets how records may be stored now (sw_records_limit), and checks the progress of an erasure. */
static void look_after_records(sw_node *node)
{
    if (!node->has_begun) node->begun_ns = node->services.request.now_ns;
    node->has_begun = 1;
    node->store.records.limit = node->services.request.drives_jets ? SW_RECORDS_APPEND : SW_RECORDS_MOVE;
    if (sw_store_is_erasing(&node->store) && node->store.work != SW_WORK_CLEAR) sw_records_care(&node->store.records);
}

/* Maintains the records while diagnosis is idle. Except during an update, no erasure begins while the vehicle requests
 * control, or shortly after power-on, because a request may soon follow. An erasure that has begun is completed.
 */
static void care_for_records(sw_node *node)
{
    const sw_vehicle_request *request = &node->services.request;
    const int is_quiet = request->now_ns - node->begun_ns >= SW_REMEMBERED_NS && sw_request_refusal(request) == 0u;
    if (!sw_store_is_erasing(&node->store) && (node->services.programming.is_updating || is_quiet)) {
        sw_records_care(&node->store.records);
    }
}

#if SW_XCP
/* Processes the calibration tool's frames. A requested write to the store waits until UDS and flash memory are idle. */
static void hear_tool(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count)
{
    const int may_store = !sw_uds_is_busy(&node->services.uds) && !sw_store_is_erasing(&node->store);
    if (node->ecu.numbers.release == NULL) return;
    for (int i = 0; i < count; i++) {
        if (sw_xcp_is_command(&frames_in[i])) sw_xcp_command(&node->xcp, now_ns, &frames_in[i]);
    }
    sw_xcp_look(&node->xcp, now_ns, may_store);
}
#endif

static int sent_now(sw_node *node, int64_t time_ns, int room, sw_frame *frames_out)
{
    int sent = sw_isotp_poll(&node->isotp, time_ns, room, frames_out);
    node->is_full = (uint8_t)(room < SW_ISOTP_BURST && sent == room);
#if SW_XCP
    const int places = (room < SW_ISOTP_BURST ? room : SW_ISOTP_BURST) - sent;
    sent += sw_xcp_poll(&node->xcp, time_ns, places, &frames_out[sent]);
#endif
    node->is_sending = (uint8_t)(sent > 0);
    return sent;
}

int sw_node_service(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count, int room,
                    sw_frame frames_out[SW_ISOTP_BURST])
{
    const int64_t time_ns = clipped(now_ns);
    sw_uds *uds = &node->services.uds;
    const int was_busy = sw_uds_is_busy(uds);
    if (uds->wants_reset) return node->is_full ? sent_now(node, time_ns, room, frames_out) : 0;
    node->services.request.now_ns = time_ns;
    look_after_records(node);
    sw_faults_settle(&node->services.faults);
    sw_uds_look(uds, time_ns);
    const int looked_at = count < (int)SW_MOST_FRAMES ? count : (int)SW_MOST_FRAMES;
    const uint32_t requests = take_requests(node, time_ns, frames_in, looked_at);
    /* Long work that has begun in this call has done its first part. Its next part waits for the next call. */
    if (was_busy || requests == 0u || !sw_uds_is_busy(uds)) sw_uds_tick(uds, time_ns);
#if SW_XCP
    hear_tool(node, time_ns, frames_in, looked_at);
#endif
    if (!was_busy && requests == 0u) care_for_records(node);
    return sent_now(node, time_ns, room, frames_out);
}

int sw_node_step(sw_node *node, int64_t now_ns, const sw_frame *frames_in, int count,
                 sw_frame frames_out[SW_NODE_FRAMES])
{
    const int sent = sw_node_control(node, now_ns, frames_in, count, frames_out);
    return sent + sw_node_service(node, now_ns, frames_in, count, SW_ISOTP_BURST, &frames_out[sent]);
}

int sw_node_is_busy(const sw_node *node)
{
    return node->services.uds.wants_reset || node->is_sending || sw_uds_is_busy(&node->services.uds);
}

int sw_node_waits(const sw_node *node)
{
    const sw_uds *uds = &node->services.uds;
    int waits = sw_uds_waits(uds);
#if SW_XCP
    waits |= sw_xcp_is_sending(&node->xcp) && !sw_uds_is_busy(uds);
#endif
    return uds->wants_reset || (!node->is_sending && waits);
}

int sw_node_is_request(const sw_frame *frame)
{
#if SW_XCP
    if (sw_xcp_is_command(frame)) return 1;
#endif
    return sw_isotp_is_request(frame);
}

int sw_node_wants_reset(const sw_node *node)
{
    /* If control began after the tester's request, the next control period shuts the jets first. */
    return node->services.uds.wants_reset && !node->is_full && !node->services.request.drives_jets;
}

int sw_node_needs_reset(const sw_node *node)
{
    return node->services.uds.wants_reset || node->services.programming.is_updating;
}

size_t sw_node_bytes(void) { return sizeof(sw_node); }

size_t sw_node_loader_bytes(void) { return offsetof(sw_node, ecu); }
