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
