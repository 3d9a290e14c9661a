#include "zephyr.h"
#include "ecu_port.h"
#include "board.h"

const struct device the_bus;
static can_rx_callback_t on_frame;
static struct can_filter filters[8];
static int filter_count;
static const uint8_t lengths[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

int64_t k_uptime_ticks(void) { return board_ns() / 100000; }
uint64_t k_ticks_to_ns_floor64(uint64_t ticks) { return ticks * 100000; }

int k_msgq_put(struct k_msgq *queue, const void *item, k_timeout_t timeout)
{
    (void)timeout;
    if (queue->held == queue->length) return -1;
    memcpy(queue->storage + queue->held++ * queue->size, item, queue->size);
    return 0;
}

int k_msgq_get(struct k_msgq *queue, void *item, k_timeout_t timeout)
{
    (void)timeout;
    if (queue->held == 0) return -1;
    memcpy(item, queue->storage, queue->size);
    queue->held--;
    memmove(queue->storage, queue->storage + queue->size, queue->held * queue->size);
    return 0;
}

uint8_t can_dlc_to_bytes(uint8_t dlc) { return lengths[dlc]; }

uint8_t can_bytes_to_dlc(uint8_t bytes)
{
    uint8_t dlc = 0;
    while (lengths[dlc] < bytes) dlc++;
    return dlc;
}

static void arrived(void)
{
    struct can_frame frame = {.id = board_id(), .flags = SW_FRAMES_FD ? CAN_FRAME_FDF : 0};
    frame.dlc = can_bytes_to_dlc(SW_PRESSURE_BYTES);
    board_data(frame.data);
    for (int i = 0; i < filter_count; i++) {
        if ((frame.id & filters[i].mask) == filters[i].id) on_frame(&the_bus, &frame, NULL);
    }
}

int32_t k_sleep(k_timeout_t timeout)
{
    board_wait(timeout.ns, arrived);
    return 0;
}

int can_set_mode(const struct device *device, uint32_t mode) { return (void)device, (void)mode, 0; }
int can_start(const struct device *device) { return (void)device, 0; }

int can_add_rx_filter(const struct device *device, can_rx_callback_t call, void *with, const struct can_filter *filter)
{
    (void)device, (void)with;
    on_frame = call;
    filters[filter_count] = *filter;
    return filter_count++;
}

int can_send(const struct device *device, const struct can_frame *frame, k_timeout_t wait, can_tx_callback_t call,
             void *with)
{
    (void)device, (void)wait, (void)call, (void)with;
    board_print(frame->id, frame->data, lengths[frame->dlc]);
    return 0;
}

int can_get_state(const struct device *device, enum can_state *state, struct can_bus_err_cnt *errors)
{
    (void)device;
    *state = CAN_STATE_ERROR_ACTIVE;
    *errors = (struct can_bus_err_cnt){0, 0};
    return 0;
}
