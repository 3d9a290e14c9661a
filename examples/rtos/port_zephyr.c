/* Zephyr has a CAN interface. You write only the devicetree and the configuration. */

#include <zephyr/device.h>
#include <zephyr/drivers/can.h>
#include <zephyr/kernel.h>

#include "ecu_port.h"

#define STACK_BYTES 4096
#define PRIORITY K_PRIO_COOP(1)

static const struct device *const bus = DEVICE_DT_GET(DT_CHOSEN(zephyr_canbus));
K_MSGQ_DEFINE(frames, sizeof(sw_frame), ROOM, 8);

int64_t clock_ns(void) { return (int64_t)k_ticks_to_ns_floor64((uint64_t)k_uptime_ticks()); }

void sleep_until(int64_t due_ns) { (void)k_sleep(K_TIMEOUT_ABS_NS(due_ns)); }

static void received_frame(const struct device *device, struct can_frame *frame, void *unused)
{
    sw_frame taken = {.timestamp_ns = clock_ns(), .id = frame->id}, oldest;
    (void)device, (void)unused;
    taken.is_extended = (frame->flags & CAN_FRAME_IDE) != 0;
    taken.is_fd = (frame->flags & CAN_FRAME_FDF) != 0;
    taken.length = can_dlc_to_bytes(frame->dlc);
    for (int i = 0; i < taken.length; i++) taken.data[i] = frame->data[i];
    if (k_msgq_put(&frames, &taken, K_NO_WAIT) != 0) {
        (void)k_msgq_get(&frames, &oldest, K_NO_WAIT);
        (void)k_msgq_put(&frames, &taken, K_NO_WAIT);
    }
}

int take_frames(sw_frame *taken, int room)
{
    int count = 0;
    while (count < room && k_msgq_get(&frames, &taken[count], K_NO_WAIT) == 0) count++;
    return count;
}

/* A callback that does nothing. Without a callback, can_send would wait until the frame is sent. */
static void sent(const struct device *device, int error, void *unused) { (void)device, (void)error, (void)unused; }

void send_frame(const sw_frame *frame)
{
    struct can_frame out = {.id = frame->id, .dlc = can_bytes_to_dlc(frame->length)};
    if (frame->is_extended) out.flags |= CAN_FRAME_IDE;
    if (frame->is_fd) out.flags |= CAN_FRAME_FDF | CAN_FRAME_BRS;
    for (int i = 0; i < frame->length; i++) out.data[i] = frame->data[i];
    (void)can_send(bus, &out, K_NO_WAIT, sent, NULL);
}

void note_health(sw_bus_health *health)
{
    enum can_state state;
    struct can_bus_err_cnt errors;
    if (can_get_state(bus, &state, &errors) != 0) return;
    const uint8_t is_off = state == CAN_STATE_BUS_OFF;
    if (is_off && !health->is_bus_off) health->bus_off++;
    health->is_bus_off = is_off;
    health->tx_errors = errors.tx_err_cnt;
    health->rx_errors = errors.rx_err_cnt;
}

static void thread(void *one, void *two, void *three)
{
    static const uint32_t heard[] = HEARD;
    (void)one, (void)two, (void)three;
    if (SW_FRAMES_FD) (void)can_set_mode(bus, CAN_MODE_FD);
    for (size_t i = 0; i < sizeof heard / sizeof heard[0]; i++) {
        const struct can_filter filter = {.id = heard[i], .mask = CAN_STD_ID_MASK};
        (void)can_add_rx_filter(bus, received_frame, NULL, &filter);
    }
    (void)can_start(bus);
    controller_task();
}

K_THREAD_DEFINE(ecu_thread, STACK_BYTES, thread, NULL, NULL, NULL, PRIORITY, K_FP_REGS, 0);
