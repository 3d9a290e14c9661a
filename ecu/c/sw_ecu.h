/* The ECU around a control step: CAN frames in, jet command and status out, once a control period.
 *
 * It is the twin of the Python ECU (ecu), which is its specification: the same frames at the same times
 * lead to the same frames and the same state. Freestanding C99. No allocation, no recursion, no library calls, no
 * static state: everything stands in the caller's sw_ecu. sw_ecu_settings.h, generated, has the messages of the DBC,
 * the figures of the release that is compiled in, and the vehicle's settings.
 *
 *     static sw_ecu ecu;
 *     sw_ecu_init(&ecu);
 *     every control period:
 *         count = sw_ecu_step(&ecu, now_ns, frames_in, n, frames_out);   send frames_out[0 .. count - 1]
 *
 * Decisions are made in integers and in double, in the order of operations of the Python ECU, and so are the same to
 * the bit; the control step and the sensor estimates are in float and int8.
 */
#ifndef SW_ECU_H
#define SW_ECU_H

#include "sw_ecu_state.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Power-on: nothing received, nothing sent, jets shut, the release's own calibration. Memory of zeros is no substitute:
 * it would hold a request for control that was seen low, and a sensor set aside. Returns
 * SW_REASON_NONE, or SW_REASON_INTERNAL where this build, or the processor as it is set, computes otherwise than its
 * decisions need (sw_arithmetic; contraction). Every step looks at it again: while it is so, the jets are shut for that
 * reason. The same, up to the next init, where a control step on a known window answers otherwise than the exporter's
 * (sw_known_answer). It takes as long as the longest step; a build with SW_WITHOUT_KNOWN_ANSWER leaves it out.
 */
int sw_ecu_init(sw_ecu *ecu);

/* The same with the numbers of a release that stands elsewhere, as sw_image_open gives them. What they point to must stay
 * as long as the ECU runs; `numbers` itself need not.
 */
int sw_ecu_init_of(sw_ecu *ecu, const sw_numbers *numbers);

#if SW_SECOC
/* The bus' key and what is left of earlier power cycles, once after an init and before the first step. Without it nothing
 * is sent, and every frame is refused. Returns 0, or 1 for a key of zeros or a trip of 0, and then there is no key.
 *
 * The caller overwrites `given` afterwards. It keeps in lasting memory what is newest in state.pressures.verifier and
 * state.speed.receiver.verifier: a node that restarts takes everything that is newer than what was kept.
 */
int sw_ecu_authenticate(sw_ecu *ecu, const sw_authentication *given);
#endif

/* Other values from the next step on; call it between two steps. Returns 0, or the number of the first value that is
 * out of the limits of release and vehicle, counted from 1 in the order of the structure; nothing is changed then. What
 * was sent stays as it was sent, and a narrower range bounds the very next command. A state that is loaded must be of
 * the same delay.
 */
int sw_ecu_calibrate(sw_ecu *ecu, const sw_calibration *values);

/* Go on from a state that was saved: `state` of an sw_ecu of the same release, settings and calibration. Returns 0, or 1
 * for one that no ECU can have left, as of memory that failed; nothing is changed then. What is checked is what would
 * lead out of an array or of a number's range. A checksum is the caller's, who knows the memory.
 */
int sw_ecu_restore(sw_ecu *ecu, const sw_ecu_state *state);

/* One control period that begins at now_ns. frames_in has everything received since the last step, oldest first; with a
 * count of 0 it may be NULL. Writes the frames to be sent, over frames_in if that is the same memory, and returns how
 * many. A step that takes longer than a period is seen in the next one, by that one's time.
 */
int sw_ecu_step(sw_ecu *ecu, int64_t now_ns, const sw_frame *frames_in, int count, sw_frame frames_out[SW_FRAMES_OUT]);

/* sizeof(sw_ecu) and sizeof(sw_ecu_state), for callers in other languages. */
size_t sw_ecu_bytes(void);
size_t sw_ecu_state_bytes(void);

#ifdef __cplusplus
}
#endif

#endif
