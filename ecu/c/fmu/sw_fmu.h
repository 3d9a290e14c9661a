/* The parts of the ECU's FMU: instances, variables and states (sw_fmu.c), and a "side", which sends frames to the ECU
 * and receives its frames. The side is a simulated vehicle whose inputs are signals (signals/sw_fmu_signals.c), or a
 * bus terminal as in FMI-LS-BUS (bus/sw_fmu_bus.c).
 */
#ifndef SW_FMU_H
#define SW_FMU_H

#include "sw_ecu.h"
#include "sw_fmi3_calls.h"
#include "sw_fmu_settings.h"

#define FMU_MOST_FRAMES 256 /* largest number of frames between two steps; a full bus at 500 kbit/s has fewer */

typedef enum { FLOAT32, FLOAT64, INT8, UINT8, INT16, UINT16, INT32, UINT32, INT64, UINT64, BOOLEAN } kind;
typedef enum { OUTPUT, INPUT, PARAMETER } causality;
enum { NO_MESSAGE, PRESSURE, SPEED, COMMAND, STATUS };

/* A variable of the FMU, and its signal in the DBC. */
typedef struct {
    kind type; /* type of its get and set functions */
    causality direction;
    double first; /* value at the start */
    int message;
    int start; /* first bit of the signal in its message */
    int bits;
    int is_signed;
    double scale;
} variable;

extern const variable fmu_variables[SW_FMU_VARIABLES];

#if SW_FMU_BUS
#define RX_BYTES 8192u
#define TX_BYTES 16384u /* has room for a format error that quotes all of Rx_Data */

/* A simulated CAN controller, its mailboxes, and the binary variables of the terminal. Times count from the start. */
typedef struct {
    sw_bus_health health;
    int64_t reached_ns;
    int64_t off_until_ns;
    int64_t answer_ns; /* time at which `answers` are to be sent */
    int32_t waiting;   /* number of answers not in `tx` yet; sent answers stay stored, so that they can be repeated */
    int32_t received;
    uint8_t status; /* status last reported to the bus simulation */
    uint8_t has_lost;
    fmi3Clock rx_ticks; /* whether Rx_Clock ticks in this event */
    fmi3Clock tx_ticks;
    uint32_t rx_bytes;
    uint32_t tx_bytes;
    sw_frame answers[SW_FRAMES_OUT];
    sw_frame frames[FMU_MOST_FRAMES];
    uint8_t rx[RX_BYTES];
    uint8_t tx[TX_BYTES];
} fmu_side;
#else
typedef struct {
    uint8_t pressure_counter;
    uint8_t speed_counter;
} fmu_side;
#endif

/* The wrapper's memory; the ECU has a separate memory. */
typedef struct {
    double values[SW_FMU_VARIABLES]; /* variables by value reference; reference 0 is the time */
    double start;
    int64_t next_ns; /* time from the start to the ECU's next step, in ns */
    uint32_t mode;   /* mode in FMI's state machine */
    fmu_side side;
} fmu_memory;

typedef struct {
    sw_ecu ecu; /* first member, because of its alignment */
    fmu_memory kept;
    fmu_logger logger;
    int has_event_mode;
    void *room; /* address of the allocation */
} fmu_instance;

/* --- Functions that each side implements --- */

/* Begins the run, at the end of the initialisation. Returns the error in a parameter, or NULL. */
fmi3String fmu_begun(fmu_memory *kept);

/* Returns whether the ECU's next step belongs to a communication step that ends at `until_ns`. */
int fmu_is_due(const fmu_memory *kept, double until_ns);

/* Writes the ECU's surroundings, and the frames that its next step receives; returns the number of frames. */
int fmu_received(fmu_memory *kept, sw_frame frames[FMU_MOST_FRAMES], sw_surroundings *around);

/* Processes the frames that the ECU sends in this step. */
void fmu_sent(fmu_memory *kept, const sw_frame *frames, int count);

/* Ends a communication step; returns whether frames have to be sent. */
int fmu_reached(fmu_instance *fmu, double until_ns);

/* Returns whether `side` is a state that a run can reach. */
int fmu_is_possible(const fmu_side *side);

#endif
