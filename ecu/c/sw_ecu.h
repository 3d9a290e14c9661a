/* The ECU around a control step: it takes CAN frames and returns a jet command and a status, once a control period.
 *
 * The Python ECU (ecu) is the specification of this code: equal frames at equal times lead to equal frames and an equal
 * state. The code is freestanding C99, without allocation, recursion, library calls or static state: all memory is in
 * the caller's sw_ecu. The generated sw_ecu_settings.h has the messages of the DBC, the parameters of the release that
 * is compiled in, and the vehicle's settings.
 *
 *     static sw_ecu ecu;
 *     sw_ecu_init(&ecu);
 *     every control period:
 *         count = sw_ecu_step(&ecu, now_ns, frames_in, n, frames_out);   send frames_out[0 .. count - 1]
 *
 * Decisions are made in integers and doubles, in the Python ECU's order of operations, so that both ECUs' decisions are
 * equal bit for bit. The control step and the sensor estimates use float and int8.
 */
#ifndef SW_ECU_H
#define SW_ECU_H

#include "sw_ecu_state.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Initialises the ECU as at power-on: nothing has been received or sent, the jets are shut, and the release's own
 * calibration is in force. Zeros in the memory do not initialise the ECU: they would mean that the request for control
 * was low, and that a sensor is excluded. Returns SW_REASON_NONE, or SW_REASON_INTERNAL if this build or the
 * processor's present mode does not compute as exactly as the decisions need (sw_inexact). Every step repeats this
 * check and shuts the jets while it fails. The call also compares a control step's answer to a known window with the
 * exporter's answer (sw_known_answer). If they differ, the jets stay shut until the next init. The comparison takes as
 * long as the longest step; a build with SW_WITHOUT_KNOWN_ANSWER omits it.
 */
int sw_ecu_init(sw_ecu *ecu);

/* Initialises the ECU with the parameters of a release that is not compiled in, for example from sw_image_open. The
 * struct *numbers is copied. The parameters to which its members point must stay valid while the ECU runs.
 */
int sw_ecu_init_of(sw_ecu *ecu, const sw_numbers *numbers);

#if SW_SECOC
/* Gives the ECU the bus key and the freshness values of earlier power cycles. Call it once after an init, before the
 * first step. Without a key the ECU sends nothing and refuses every frame. Returns 0, or 1 for a key of zeros or a trip
 * of 0; the ECU then has no key.
 *
 * The caller must then overwrite `given`. The caller must also store the newest values of state.pressures.verifier and
 * state.speed.receiver.verifier in non-volatile memory, because a restarted node accepts every frame that is newer than
 * the stored values.
 */
int sw_ecu_authenticate(sw_ecu *ecu, const sw_authentication *given);
#endif

/* Changes the calibration from the next step on; call it between two steps. Returns 0, or the number of the first value
 * outside the limits of release and vehicle, counted from 1 in the structure's order; the calibration is then
 * unchanged. Actions that were sent do not change. A narrower range limits the next command. A state can be restored
 * only if the delay is the same as when the state was saved.
 */
int sw_ecu_calibrate(sw_ecu *ecu, const sw_calibration *values);

/* Continues from a saved state: `state` of an sw_ecu with the same release, settings and calibration. Returns 0; or 1,
 * and leaves the ECU unchanged, if the delay differs, or if no ECU can reach the state, for example after a memory
 * failure. Checks only values that would lead outside an array or a number's range; the caller may add a checksum.
 */
int sw_ecu_restore(sw_ecu *ecu, const sw_ecu_state *state);

/* Runs one control period that begins at now_ns. frames_in has all frames received since the last step, oldest first;
 * if count is 0, frames_in may be NULL. Writes the frames to send, possibly over frames_in, and returns their number.
 * If a step takes longer than a period, the next step detects this from its now_ns.
 */
int sw_ecu_step(sw_ecu *ecu, int64_t now_ns, const sw_frame *frames_in, int count, sw_frame frames_out[SW_FRAMES_OUT]);

/* Return sizeof(sw_ecu) and sizeof(sw_ecu_state), for callers in other languages. */
size_t sw_ecu_bytes(void);
size_t sw_ecu_state_bytes(void);

#ifdef __cplusplus
}
#endif

#endif
