/* FreeRTOS has no CAN interface. Write clock_ns, and write the three board_ functions in your driver. clock_ns must
 * read a free-running hardware timer, because the tick counter is too coarse, and its interrupt may be late. */

#include "FreeRTOS.h"
#include "queue.h"
#include "task.h"

#include "ecu_port.h"

#define TICK_NS (INT64_C(1000000000) / (int64_t)configTICK_RATE_HZ)
#define STACK_WORDS 1024
#define PRIORITY (configMAX_PRIORITIES - 1)

/* Functions of your driver. board_read_frame writes the frame that caused the interrupt, but not its time. */
void board_read_frame(sw_frame *frame);
void board_send_frame(const sw_frame *frame);
void board_health(sw_bus_health *health);

void can_rx_isr(void); /* put this function into the vector table */
void start_ecu(void);  /* call this function before vTaskStartScheduler */

static QueueHandle_t frames;

static int is_heard(const sw_frame *frame)
{
    static const uint32_t heard[] = HEARD;
    for (size_t i = 0; i < sizeof heard / sizeof heard[0]; i++) {
        if (frame->id == heard[i] && !frame->is_extended) return 1;
    }
    return 0;
}

void can_rx_isr(void)
{
    BaseType_t woken = pdFALSE;
    sw_frame frame, oldest;
    frame.timestamp_ns = clock_ns();
    board_read_frame(&frame);
    if (!is_heard(&frame)) return;
    if (xQueueIsQueueFullFromISR(frames) != pdFALSE) (void)xQueueReceiveFromISR(frames, &oldest, &woken);
    (void)xQueueSendFromISR(frames, &frame, &woken);
    portYIELD_FROM_ISR(woken);
}

void sleep_until(int64_t due_ns)
{
    const int64_t left_ns = due_ns - clock_ns();
    if (left_ns > 0) vTaskDelay((TickType_t)(left_ns / TICK_NS) + 1);
}

int take_frames(sw_frame *taken, int room)
{
    int count = 0;
    while (count < room && xQueueReceive(frames, &taken[count], 0) == pdTRUE) count++;
    return count;
}

void send_frame(const sw_frame *frame) { board_send_frame(frame); }

void note_health(sw_bus_health *health) { board_health(health); }

static void task(void *unused)
{
    (void)unused;
    controller_task();
}

void start_ecu(void)
{
    static StaticQueue_t queue;
    static uint8_t storage[ROOM * sizeof(sw_frame)];
    static StaticTask_t control;
    static StackType_t stack[STACK_WORDS];
    frames = xQueueCreateStatic(ROOM, sizeof(sw_frame), storage, &queue);
    (void)xTaskCreateStatic(task, "ecu", STACK_WORDS, NULL, PRIORITY, stack, &control);
}
