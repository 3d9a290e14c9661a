/* The whole ECU on a bare Cortex-M7: one call per control period. What stands around it, a CAN controller and a timer,
 * writes the time, where the received frames are and how many, and takes the answers.
 */
#include "mcu_start.h"
#include "sw_ecu.h"

int mcu_ecu_step(void);
int mcu_ecu_calibrate(void);

sw_ecu mcu_ecu;
int64_t mcu_now_ns;
const sw_frame *mcu_frames_in;
int mcu_count;
sw_calibration mcu_calibration;
sw_frame mcu_frames_out[SW_FRAMES_OUT];

void mcu_begin(void) { sw_ecu_init(&mcu_ecu); }

int mcu_ecu_step(void) { return sw_ecu_step(&mcu_ecu, mcu_now_ns, mcu_frames_in, mcu_count, mcu_frames_out); }

int mcu_ecu_calibrate(void) { return sw_ecu_calibrate(&mcu_ecu, &mcu_calibration); }
