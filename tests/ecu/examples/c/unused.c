/* The system around ecu_task.c, with pressures in the middle of each period and an ECU that uses none of them. It prints
 * when the steps begin, in us after a period's beginning.
 */
#include <stdio.h>
#include <stdlib.h>
#include "ecu_port.h"

static int64_t now = SW_STEP_OFFSET_NS;

int sw_ecu_init(sw_ecu *ecu) { return ecu == NULL; }

int sw_ecu_step(sw_ecu *ecu, int64_t now_ns, const sw_frame *frames_in, int count, sw_frame frames_out[SW_FRAMES_OUT])
{
    (void)frames_in, (void)count, (void)frames_out;
    printf("%ld\n", (long)(now_ns % SW_PERIOD_NS / 1000));
    if (++ecu->state.missed == 40u) exit(0);
    return 0;
}

int64_t clock_ns(void) { return now; }
void sleep_until(int64_t due_ns) { now = due_ns; }
void send_frame(const sw_frame *frame) { (void)frame; }
void note_health(sw_bus_health *health) { (void)health; }

int take_frames(sw_frame *frames, int room)
{
    (void)room;
    frames[0].id = SW_PRESSURE_ID;
    frames[0].timestamp_ns = (now / SW_PERIOD_NS - 1) * SW_PERIOD_NS + SW_PERIOD_NS / 2;
    return 1;
}

int main(void)
{
    controller_task();
    return 0;
}
