/* Store and diagnosis alone, to be sized: what they call of the ECU is empty, and a loop calls them. */
#include <stddef.h>

#include "sw_ecu_parts.h"
#include "sw_image.h"
#include "sw_node.h"

volatile int64_t clock_ns;
static sw_frame in, out[SW_NODE_FRAMES];
static sw_node node;
sw_equipment equipment;
sw_flash flash;
uint8_t loader_memory[offsetof(sw_node, ecu) + SW_ISOTP_MOST];

void start(void)
{
    (void)sw_node_init(&node, &equipment, &flash, loader_memory);
    for (;;) {
        (void)sw_node_step(&node, clock_ns, &in, 1, out);
        if (sw_node_is_busy(&node) || sw_node_needs_reset(&node)) (void)sw_node_service(&node, clock_ns, &in, 1, SW_ISOTP_BURST, out);
    }
}

/* Of the ECU. */
int sw_ecu_step(sw_ecu *ecu, int64_t now_ns, const sw_frame *frames, int count, sw_frame *frames_out)
{
    (void)ecu, (void)now_ns, (void)frames, (void)count, (void)frames_out;
    return 0;
}
int sw_ecu_init_of(sw_ecu *ecu, const sw_numbers *numbers)
{
    (void)ecu, (void)numbers;
    return 0;
}
uint8_t sw_inexact(void) { return SW_REASON_NONE; }
int sw_ecu_calibrate(sw_ecu *ecu, const sw_calibration *values)
{
    (void)ecu, (void)values;
    return 0;
}
int sw_calibration_beyond(const sw_calibration *values, const sw_release *release)
{
    (void)values, (void)release;
    return 0;
}
int sw_drives_jets(uint8_t mode) { return mode; }
uint8_t sw_mode_on_wire(uint8_t mode) { return mode; }
void sw_calibration_bounds(const float *weights, sw_calibration *low, sw_calibration *high)
{
    (void)weights, (void)low, (void)high;
}
void sw_calibration_own(const sw_release *release, sw_calibration *own) { (void)release, (void)own; }
int sw_write_frames(sw_ecu_state *state, const sw_jet_command *command, uint32_t bundle_hash, int64_t now_ns,
                    sw_frame *frames_out)
{
    (void)state, (void)command, (void)bundle_hash, (void)now_ns, (void)frames_out;
    return SW_FRAMES_OUT;
}
sw_status sw_control_step_of(const sw_program *program, sw_workspace *work, const sw_input *input, sw_output *output)
{
    (void)program, (void)work, (void)input, (void)output;
    return SW_OK;
}
sw_image_status sw_image_open(const uint8_t *image, sw_numbers *numbers)
{
    (void)image, (void)numbers;
    return SW_IMAGE_OK;
}
