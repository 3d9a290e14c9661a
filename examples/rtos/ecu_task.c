/* The ECU as a task, for any system that provides the functions of ecu_port.h.
 *
 * Deadlines are absolute, so that delays do not add up. They slowly follow the pressures' arrival times, because the
 * clocks of the vehicle and the ECU drift apart. A step that would begin more than a quarter of a period late is
 * skipped. The next step detects and counts the skipped period. */

#include "ecu_port.h"

#define GRACE 4         /* a step that would begin more than SW_PERIOD_NS / GRACE late is skipped */
#define LARGEST_SLEW 32 /* a deadline is corrected by at most SW_PERIOD_NS / LARGEST_SLEW */

static sw_ecu ecu; /* all memory of the ECU */
static sw_frame received[ROOM], to_send[SW_FRAMES_OUT];

static int64_t next_due(int64_t due_ns, int64_t arrived_ns)
{
    const int64_t late_ns = clock_ns() - due_ns - SW_PERIOD_NS / GRACE;
    const int64_t next_ns = due_ns + SW_PERIOD_NS * (late_ns > 0 ? (late_ns - 1) / SW_PERIOD_NS + 1 : 1);
    const int64_t most_ns = SW_PERIOD_NS / LARGEST_SLEW;
    if (arrived_ns < 0) return next_ns;
    int64_t error_ns = (arrived_ns + SW_STEP_OFFSET_NS - next_ns) % SW_PERIOD_NS;
    if (error_ns > SW_PERIOD_NS / 2) error_ns -= SW_PERIOD_NS;
    if (error_ns < -SW_PERIOD_NS / 2) error_ns += SW_PERIOD_NS;
    if (error_ns > most_ns) error_ns = most_ns;
    if (error_ns < -most_ns) error_ns = -most_ns;
    return next_ns + error_ns;
}

void controller_task(void)
{
    int64_t due_ns = clock_ns() + SW_PERIOD_NS;
    (void)sw_ecu_init(&ecu); /* if this call fails, the jets stay shut, and EcuStatus has the reason */
#if SW_SECOC
    sw_authentication given = {{0}, 0, 0, 0};
    if (read_authentication(&given) == 0) (void)sw_ecu_authenticate(&ecu, &given); /* without a key nothing is sent */
    for (int i = 0; i < SW_AES_BYTES; i++) ((volatile uint8_t *)given.key)[i] = 0;
#endif
    for (;;) {
        const uint32_t missed_before = ecu.state.missed;
        int64_t arrived_ns = -1;
        sleep_until(due_ns);
        const int count = take_frames(received, ROOM);
        for (int i = 0; i < count; i++) {
            if (received[i].id == SW_PRESSURE_ID) arrived_ns = received[i].timestamp_ns;
        }
        note_health(&ecu.surroundings.health);
        const int sent = sw_ecu_step(&ecu, clock_ns(), received, count, to_send);
        for (int i = 0; i < sent; i++) send_frame(&to_send[i]);
#if SW_SECOC
        if (ecu.secoc.is_given) keep_freshness(&ecu.state); /* without a key the stored values stay as they are */
#endif
        /* Pressures that the ECU did not use, for example invalid ones, do not move the deadlines. */
        due_ns = next_due(due_ns, ecu.state.missed == missed_before ? arrived_ns : -1);
    }
}
