/* The program: it reads frames, steps the ECU once a control period, answers diagnosis and sleeps. A step begins when
 * the pressures arrive. If no pressures arrive, it begins half a period after they were due.
 */
#include "sw_board.h"
#include "sw_board_equipment.h"
#include "sw_ecu.h"
#if SW_BOARD_LOADER
#include "sw_image.h"
#include "sw_layout.h"
#include "sw_node.h"
#endif

#define ROOM 128

static sw_frame received[ROOM]; /* frames received since the last step, oldest first */

typedef struct {
    int64_t latest_ns;   /* time of the latest step */
    int64_t deadline_ns; /* time of the next step if no pressures arrive */
    int count;           /* number of frames received since the last step */
    uint8_t came;        /* whether the received frames include pressures */
} sw_board_period;

#if SW_BOARD_LOADER

#define SERVICE_NS INT64_C(1000000)  /* time between two checks for timeouts of diagnosis, in ns */
#define TALKS_NS INT64_C(5000000000) /* time for which these checks continue after a diagnostic frame, in ns */

static sw_node node;
static uint8_t message[SW_ISOTP_MOST];
/* The release runs from this copy in RAM, because the core cannot read the release's flash bank during an erasure. */
static uint8_t image[SW_IMAGE_HEADER + sizeof(sw_payload)] __attribute__((aligned(64)));
static int64_t talks_until_ns;

sw_ecu *const sw_board_ecu = &node.ecu;
sw_store *const sw_board_store = &node.store;

static int random(void *context, uint8_t *bytes, uint32_t count)
{
    uint8_t failed = 0;
    (void)context;
    for (uint32_t i = 0; i < count && failed == 0u; i++) bytes[i] = (uint8_t)sw_board_random(&failed);
    return failed;
}

static void begin(void)
{
    static const sw_rules rules = {SW_BOARD_ROOT, SW_LAYOUT_SHA256, SW_DBC_SHA256_BYTES, SW_BOARD_HARDWARE,
                                   SW_BOARD_VEHICLE};
    static const uint8_t access_key[SW_AES_BYTES] = SW_BOARD_ACCESS_KEY;
    static const sw_equipment equipment = {
        &rules, access_key, SW_BOARD_HARDWARE, SW_BOARD_SERIAL, SW_BOARD_SOFTWARE, random, 0,
        image, sizeof image,
    };
    (void)sw_node_init(&node, &equipment, &sw_board_flash, message);
}

static int control(int64_t now_ns, int count, sw_frame *answers)
{
    return sw_node_control(&node, now_ns, received, count, answers);
}

/* Runs diagnosis with the new frames. Returns the time at which diagnosis is due next. */
static int64_t serve(const sw_frame *frames, int count, int64_t now_ns)
{
    sw_frame answers[SW_ISOTP_BURST];
    for (int i = 0; i < count; i++) {
        if (sw_node_is_request(&frames[i])) talks_until_ns = now_ns + TALKS_NS;
    }
    const int sent = sw_node_service(&node, now_ns, frames, count, sw_board_can_room(), answers);
    for (int i = 0; i < sent; i++) sw_board_can_queue(&answers[i]);
    if (sw_node_wants_reset(&node) && sw_board_can_is_idle()) sw_board_reset();
    const int waits = sw_node_waits(&node);
    if (sw_node_is_busy(&node) && !waits) return now_ns;
    return now_ns < talks_until_ns || waits ? now_ns + SERVICE_NS : INT64_MAX;
}

#else

static sw_ecu ecu;

/* The ECU, which a debugger or a test bench may read. */
sw_ecu *const sw_board_ecu = &ecu;

static void begin(void) { (void)sw_ecu_init(&ecu); }

static int control(int64_t now_ns, int count, sw_frame *answers)
{
    return sw_ecu_step(&ecu, now_ns, received, count, answers);
}

static int sw_node_is_request(const sw_frame *frame)
{
    (void)frame;
    return 0;
}

static int64_t serve(const sw_frame *frames, int count, int64_t now_ns)
{
    (void)frames;
    (void)count;
    (void)now_ns;
    return INT64_MAX;
}

#endif

#if SW_SECOC
static void authenticate(void)
{
    sw_authentication given;
    if (sw_board_authentication(&given) == 0) (void)sw_ecu_authenticate(sw_board_ecu, &given);
    for (uint32_t i = 0; i < sizeof given; i++) ((volatile uint8_t *)&given)[i] = 0;
}
#endif

#define OF_DIAGNOSIS (SW_DIAGNOSIS_EXTENDED != 0 ? SW_BOARD_EXTENDED : 0u)

static const uint32_t ids[] = {
    SW_PRESSURE_ID, SW_COMMAND_ID, SW_STATUS_ID,
#if SW_PAST > 0
    SW_SPEED_ID,
#endif
#if SW_BOARD_LOADER
    SW_REQUEST_ID | OF_DIAGNOSIS,
#if SW_FUNCTIONAL
    SW_FUNCTIONAL_ID | OF_DIAGNOSIS,
#endif
#if SW_XCP
    SW_XCP_COMMAND_ID | (SW_XCP_EXTENDED != 0 ? SW_BOARD_EXTENDED : 0u),
#endif
#endif
};

volatile uint32_t sw_board_steps; /* number of steps so far */

static void receive(sw_board_period *period)
{
    const int before = period->count;
    period->count += sw_board_can_receive(&received[before], ROOM - before);
    for (int i = before; i < period->count; i++) {
        if (received[i].id == (uint32_t)SW_PRESSURE_ID && !received[i].is_extended) period->came = 1;
    }
}

/* Removes the diagnostic frames among received[first] and the frames after it: control does not use them. */
static void drop_requests(sw_board_period *period, int first)
{
    int kept = first;
    for (int i = first; i < period->count; i++) {
        if (!sw_node_is_request(&received[i])) received[kept++] = received[i];
    }
    period->count = kept;
}

/* Returns whether a step is due. A second frame of pressures in a period does not cause a second step. */
static int is_due(const sw_board_period *period, int64_t now_ns)
{
    return now_ns >= period->deadline_ns ||
           (period->came != 0u && now_ns - period->latest_ns > (int64_t)SW_PERIOD_NS / 4);
}

static void step(sw_board_period *period, int64_t now_ns)
{
    static sw_frame answers[SW_FRAMES_OUT];
    const int sent = control(now_ns, period->count, answers);
    for (int i = 0; i < sent; i++) (void)sw_board_can_send(&answers[i], (uint32_t)i);
#if SW_SECOC
    /* Without a key the state has no freshness, and the stored values must stay. */
    if (sw_board_ecu->secoc.is_given != 0u) sw_board_keep_freshness(&sw_board_ecu->state);
#endif
    const int64_t next_ns = now_ns + (int64_t)SW_PERIOD_NS;
    period->deadline_ns = period->came != 0u ? next_ns + (int64_t)SW_PERIOD_NS / 2 : next_ns;
    period->latest_ns = now_ns;
    period->count = 0;
    period->came = 0;
    sw_board_steps++;
}

void sw_board_main(void)
{
    sw_board_period period = {0, 0, 0, 0};
    begin();
#if SW_SECOC
    authenticate();
#endif
    sw_board_can_start(ids, (uint32_t)(sizeof ids / sizeof ids[0]));
    period.latest_ns = sw_board_now_ns() - (int64_t)SW_PERIOD_NS;
    period.deadline_ns = period.latest_ns + 2 * (int64_t)SW_PERIOD_NS;
    for (;;) {
        const int64_t now_ns = sw_board_now_ns();
        const int first = period.count;
        sw_board_can_health(&sw_board_ecu->surroundings.health);
        receive(&period);
        const int count = period.count - first;
        const int due = is_due(&period, now_ns);
        if (due) step(&period, now_ns);
        const int64_t next_ns = serve(&received[first], count, now_ns);
        if (!due) drop_requests(&period, first);
        sw_board_alive();
        if (next_ns > now_ns) sw_board_sleep(next_ns < period.deadline_ns ? next_ns : period.deadline_ns);
    }
}
