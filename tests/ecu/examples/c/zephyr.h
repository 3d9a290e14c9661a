#ifndef ZEPHYR_H
#define ZEPHYR_H
#include <stddef.h>
#include <stdint.h>
#include <string.h>
struct device { int unused; };
extern const struct device the_bus;
#define DT_CHOSEN(name) 0
#define DEVICE_DT_GET(node) (&the_bus)
struct k_msgq { uint8_t storage[4096]; size_t size, length, held; };
typedef struct { int64_t ns; } k_timeout_t;
#define K_NO_WAIT ((k_timeout_t){0})
#define K_TIMEOUT_ABS_NS(ns) ((k_timeout_t){ns})
#define K_PRIO_COOP(number) (-(number))
#define K_FP_REGS 2
#define K_MSGQ_DEFINE(name, bytes, most, align) static struct k_msgq name = {{0}, bytes, most, 0}
#define K_THREAD_DEFINE(name, bytes, entry, one, two, three, priority, options, delay) \
    int main(void) { entry(one, two, three); return (options) + (priority) + (delay) + (bytes); } \
    struct ended
int64_t k_uptime_ticks(void);
uint64_t k_ticks_to_ns_floor64(uint64_t ticks);
int32_t k_sleep(k_timeout_t timeout);
int k_msgq_put(struct k_msgq *queue, const void *item, k_timeout_t timeout);
int k_msgq_get(struct k_msgq *queue, void *item, k_timeout_t timeout);

#define CAN_FRAME_IDE 1
#define CAN_FRAME_FDF 4
#define CAN_FRAME_BRS 8
#define CAN_MODE_FD 4
#define CAN_STD_ID_MASK 0x7ffu
struct can_frame { uint32_t id; uint8_t dlc, flags; uint16_t timestamp; uint8_t data[64]; };
struct can_filter { uint32_t id, mask; uint8_t flags; };
struct can_bus_err_cnt { uint8_t tx_err_cnt, rx_err_cnt; };
enum can_state { CAN_STATE_ERROR_ACTIVE, CAN_STATE_BUS_OFF };
typedef void (*can_rx_callback_t)(const struct device *device, struct can_frame *frame, void *with);
typedef void (*can_tx_callback_t)(const struct device *device, int error, void *with);
uint8_t can_dlc_to_bytes(uint8_t dlc);
uint8_t can_bytes_to_dlc(uint8_t bytes);
int can_set_mode(const struct device *device, uint32_t mode);
int can_start(const struct device *device);
int can_add_rx_filter(const struct device *device, can_rx_callback_t call, void *with, const struct can_filter *filter);
int can_send(const struct device *device, const struct can_frame *frame, k_timeout_t wait, can_tx_callback_t call,
             void *with);
int can_get_state(const struct device *device, enum can_state *state, struct can_bus_err_cnt *errors);
#endif
