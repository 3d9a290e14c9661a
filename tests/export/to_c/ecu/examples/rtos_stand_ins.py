"""FreeRTOS and Zephyr as far as the page on them uses either: one thread, and time that passes while it sleeps.

Both play the vehicle of `pressures.h`: a frame a control period, at its beginning, amid more frames of other nodes than
the queue holds. JetCommands are printed in hex, and the program ends when the pressures do.
"""

from typing import Final

BOARD: Final = r"""
#include <stdio.h>
#include <stdlib.h>
#include "ecu_port.h"
#include "pressures.h"
#include "board.h"

#define OTHERS 20

static int64_t now;
static uint32_t sent_pressures;
static int place; /* among the frames of a period; the pressures are in their middle */

int64_t board_ns(void) { return now; }

void board_wait(int64_t until_ns, void (*arrived)(void))
{
    while ((int64_t)(sent_pressures + 1) * SW_PERIOD_NS <= until_ns) {
        if (sent_pressures == PRESSURE_PERIODS) exit(0);
        now = (int64_t)(sent_pressures + 1) * SW_PERIOD_NS;
        for (place = 0; place <= 2 * OTHERS; place++) arrived();
        sent_pressures++;
    }
    if (until_ns > now) now = until_ns;
}

uint32_t board_id(void) { return place == OTHERS ? SW_PRESSURE_ID : 0x3a0u + (uint32_t)place; }

void board_data(uint8_t *data)
{
    for (int i = 0; i < SW_PRESSURE_BYTES; i++) data[i] = pressures[sent_pressures][i];
}

void board_print(uint32_t id, const uint8_t *data, int length)
{
    if (id != SW_COMMAND_ID) return;
    for (int i = 0; i < length; i++) printf("%02x", data[i]);
    printf("\n");
}
"""

BOARD_H: Final = r"""
#ifndef BOARD_H
#define BOARD_H
#include <stdint.h>
int64_t board_ns(void);
void board_wait(int64_t until_ns, void (*arrived)(void));
uint32_t board_id(void);
void board_data(uint8_t *data);
void board_print(uint32_t id, const uint8_t *data, int length);
#endif
"""

FREERTOS_H: Final = r"""
#ifndef FREERTOS_H
#define FREERTOS_H
#include <stddef.h>
#include <stdint.h>
typedef uint32_t TickType_t, StackType_t;
typedef long BaseType_t;
typedef unsigned long UBaseType_t;
typedef struct { int unused; } StaticTask_t;
typedef struct queue *QueueHandle_t;
typedef struct queue { uint8_t *storage; UBaseType_t size, length, held; } StaticQueue_t;
typedef void (*TaskFunction_t)(void *);
typedef void *TaskHandle_t;
#define pdFALSE 0
#define pdTRUE 1
#define configTICK_RATE_HZ ((TickType_t)1000)
#define configMAX_PRIORITIES 5
#define portYIELD_FROM_ISR(woken) ((void)(woken))
QueueHandle_t xQueueCreateStatic(UBaseType_t length, UBaseType_t size, uint8_t *storage, StaticQueue_t *queue);
BaseType_t xQueueIsQueueFullFromISR(QueueHandle_t queue);
BaseType_t xQueueReceive(QueueHandle_t queue, void *item, TickType_t wait);
BaseType_t xQueueReceiveFromISR(QueueHandle_t queue, void *item, BaseType_t *woken);
BaseType_t xQueueSendFromISR(QueueHandle_t queue, const void *item, BaseType_t *woken);
void vTaskDelay(TickType_t ticks);
TaskHandle_t xTaskCreateStatic(TaskFunction_t task, const char *name, uint32_t words, void *with, UBaseType_t priority,
                               StackType_t *stack, StaticTask_t *memory);
#endif
"""

FREERTOS: Final = r"""
#include <string.h>
#include "FreeRTOS.h"
#include "ecu_port.h"
#include "board.h"

void board_read_frame(sw_frame *frame);
void board_send_frame(const sw_frame *frame);
void board_health(sw_bus_health *health);
void can_rx_isr(void);
void start_ecu(void);

static TaskFunction_t created;

int64_t clock_ns(void) { return board_ns(); }

void board_read_frame(sw_frame *frame)
{
    frame->id = board_id();
    frame->is_extended = 0;
    frame->is_fd = SW_FRAMES_FD;
    frame->length = SW_PRESSURE_BYTES;
    board_data(frame->data);
}

void board_send_frame(const sw_frame *frame) { board_print(frame->id, frame->data, frame->length); }
void board_health(sw_bus_health *health) { (void)health; }

QueueHandle_t xQueueCreateStatic(UBaseType_t length, UBaseType_t size, uint8_t *storage, StaticQueue_t *queue)
{
    *queue = (StaticQueue_t){storage, size, length, 0};
    return queue;
}

BaseType_t xQueueIsQueueFullFromISR(QueueHandle_t queue) { return queue->held == queue->length; }

BaseType_t xQueueReceive(QueueHandle_t queue, void *item, TickType_t wait)
{
    (void)wait;
    if (queue->held == 0) return pdFALSE;
    memcpy(item, queue->storage, queue->size);
    queue->held--;
    memmove(queue->storage, queue->storage + queue->size, queue->held * queue->size);
    return pdTRUE;
}

BaseType_t xQueueReceiveFromISR(QueueHandle_t queue, void *item, BaseType_t *woken)
{
    (void)woken;
    return xQueueReceive(queue, item, 0);
}

BaseType_t xQueueSendFromISR(QueueHandle_t queue, const void *item, BaseType_t *woken)
{
    (void)woken;
    memcpy(queue->storage + queue->held * queue->size, item, queue->size);
    queue->held++;
    return pdTRUE;
}

void vTaskDelay(TickType_t ticks) { board_wait((board_ns() / 1000000 + (int64_t)ticks) * 1000000, can_rx_isr); }

TaskHandle_t xTaskCreateStatic(TaskFunction_t task, const char *name, uint32_t words, void *with, UBaseType_t priority,
                               StackType_t *stack, StaticTask_t *memory)
{
    (void)name, (void)words, (void)with, (void)priority, (void)stack, (void)memory;
    created = task;
    return memory;
}

int main(void)
{
    start_ecu();
    created(NULL);
}
"""

ZEPHYR_H: Final = r"""
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
"""

ZEPHYR: Final = r"""
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
"""
