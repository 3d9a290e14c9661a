/* The operations of the bus terminal (sw_fmu_bus.c) that its events (sw_fmu_events.c) use. */
#ifndef SW_FMU_BUS_H
#define SW_FMU_BUS_H

#include "sw_fmu.h"

/* Processes all operations of Rx_Data, and answers the operations that have a wrong format. */
void fmu_take_operations(fmu_memory *kept);

/* Returns the time in ns until Tx_Clock ticks: 0 if an operation waits, otherwise the time until frames are ready. */
uint64_t fmu_interval_ns(const fmu_memory *kept);

#endif
