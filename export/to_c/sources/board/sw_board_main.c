/* The program: look for frames, step the ECU once a control period, sleep. A step begins when the pressures come; without
 * them, half a period after they were due.
 */
#include "sw_board.h"

#define ROOM 128

static sw_ecu ecu;
static sw_frame received[ROOM]; /* since the latest step, oldest first */

/* For whoever looks from outside: a debugger, a test bench. */
sw_ecu *const sw_board_ecu = &ecu;

static const uint16_t ids[] = {
    SW_PRESSURE_ID, SW_COMMAND_ID, SW_STATUS_ID,
#if SW_PAST > 0
    SW_SPEED_ID,
#endif
};

typedef struct {
    int64_t latest_ns;   /* of the latest step */
    int64_t deadline_ns; /* when there is a step without pressures */
    int count;           /* of frames received since then */
    uint8_t came;        /* whether pressures are among them */
} sw_board_period;

static void receive(sw_board_period *period)
{
    const int before = period->count;
    period->count += sw_board_can_receive(&received[before], ROOM - before);
    for (int i = before; i < period->count; i++) {
        if (received[i].id == (uint32_t)SW_PRESSURE_ID) period->came = 1;
    }
}

/* Pressures that come twice in a period are no reason for two steps. */
static int is_due(const sw_board_period *period, int64_t now_ns)
{
    return now_ns >= period->deadline_ns ||
           (period->came != 0u && now_ns - period->latest_ns > (int64_t)SW_PERIOD_NS / 4);
}

static void step(sw_board_period *period, int64_t now_ns)
{
    sw_frame answers[SW_FRAMES_OUT];
    const int sent = sw_ecu_step(&ecu, now_ns, received, period->count, answers);
    for (int i = 0; i < sent; i++) (void)sw_board_can_send(&answers[i]);
    const int64_t next_ns = now_ns + (int64_t)SW_PERIOD_NS;
    period->deadline_ns = period->came != 0u ? next_ns + (int64_t)SW_PERIOD_NS / 2 : next_ns;
    period->latest_ns = now_ns;
    period->count = 0;
    period->came = 0;
}

void sw_board_main(void)
{
    sw_board_period period = {0, 0, 0, 0};
    sw_ecu_init(&ecu);
    sw_board_can_start(ids, (uint32_t)(sizeof ids / sizeof ids[0]));
    period.latest_ns = sw_board_now_ns() - (int64_t)SW_PERIOD_NS;
    period.deadline_ns = period.latest_ns + 2 * (int64_t)SW_PERIOD_NS;
    for (;;) {
        const int64_t now_ns = sw_board_now_ns();
        sw_board_can_health(&ecu.surroundings.health);
        receive(&period);
        if (is_due(&period, now_ns)) step(&period, now_ns);
        sw_board_sleep(period.deadline_ns);
    }
}
