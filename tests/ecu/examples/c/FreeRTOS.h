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
