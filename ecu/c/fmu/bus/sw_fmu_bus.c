/* The bus terminal of the ECU's FMU: CAN with the network abstraction ("low-cut") of FMI-LS-BUS 1.0.
 *
 * The binary variables carry operations. An operation has a code (4 bytes), a length (4 bytes) and arguments, all
 * little-endian. The ECU steps at start + step_offset and then once a control period, with the frames received before
 * the step. Tx_Clock ticks compute_time after the step; Tx_Data then has the ECU's frames. modelDescription.xml states
 * whether Tx_Clock is a countdown clock, or a triggered clock that ticks in the next event. Error counters follow ISO
 * 11898-1. Without BusNotifications the controller counts no errors and repeats no frames, as FMI-LS-BUS demands.
 */
#include <string.h>

#include "sw_fmu_bus.h"

/* The codes of operations, and the codes that their arguments can have. */
enum {
    FORMAT_ERROR = 0x01,
    CAN_TRANSMIT = 0x10,
    FD_TRANSMIT = 0x11,
    XL_TRANSMIT = 0x12,
    CONFIRM = 0x20,
    ARBITRATION_LOST = 0x30,
    BUS_ERROR = 0x31,
    CONFIGURATION = 0x40,
    STATUS_OPERATION = 0x41,
    WAKEUP = 0x42
};
enum { CAN_BAUDRATE = 1, FD_BAUDRATE = 2, ARBITRATION_LOST_BEHAVIOUR = 4 };
enum { BUFFER_AND_RETRANSMIT = 1 };
enum { ERROR_ACTIVE = 1, ERROR_PASSIVE = 2, BUS_OFF = 3 };
enum { BIT_ERROR = 1, ACK_ERROR = 5, BROKEN_ERROR_FRAME = 6 };
enum { PRIMARY = 1, SECONDARY = 2 };

#define HEADER 8u

/* --- Operations to be sent --- */

static void put_number(uint8_t *place, uint32_t value, uint32_t bytes)
{
    for (uint32_t i = 0; i < bytes; i++) place[i] = (uint8_t)(value >> (8u * i));
}

static uint32_t number_at(const uint8_t *place, uint32_t bytes)
{
    uint32_t value = 0;
    for (uint32_t i = 0; i < bytes; i++) value |= (uint32_t)place[i] << (8u * i);
    return value;
}

/* Appends an operation and returns the address of its arguments, or NULL if there is no room. */
static uint8_t *put_operation(fmu_side *side, uint32_t code, uint32_t arguments)
{
    if (arguments + HEADER > TX_BYTES - side->tx_bytes) {
        side->has_lost = 1;
        return NULL;
    }
    uint8_t *place = side->tx + side->tx_bytes;
    put_number(place, code, 4);
    put_number(place + 4, arguments + HEADER, 4);
    side->tx_bytes += arguments + HEADER;
    return place + HEADER;
}

static void put_frame(fmu_side *side, const sw_frame *frame)
{
    const uint32_t before = frame->is_fd ? 9 : 8; /* bytes of the arguments before the data */
    uint8_t *place = put_operation(side, frame->is_fd ? FD_TRANSMIT : CAN_TRANSMIT, before + frame->length);
    if (place == NULL) return;
    put_number(place, frame->id, 4);
    place[4] = frame->is_extended;
    place[5] = frame->is_fd; /* CAN FD: the bit rate switches; CAN: no remote frame */
    if (frame->is_fd) place[6] = side->status == ERROR_PASSIVE;
    put_number(place + before - 2, frame->length, 2);
    (void)memcpy(place + before, frame->data, frame->length);
}

static void put_configuration(fmu_side *side, uint8_t parameter, uint32_t value, uint32_t bytes)
{
    uint8_t *place = put_operation(side, CONFIGURATION, 1 + bytes);
    if (place == NULL) return;
    place[0] = parameter;
    put_number(place + 1, value, bytes);
}

static void put_format_error(fmu_side *side, const uint8_t *operation, uint32_t bytes)
{
    uint8_t *place = put_operation(side, FORMAT_ERROR, 2 + bytes);
    if (place == NULL) return;
    put_number(place, bytes, 2);
    (void)memcpy(place + 2, operation, bytes);
}

static void put_answers(fmu_side *side)
{
    for (int i = 0; i < side->waiting; i++) put_frame(side, &side->answers[i]);
    side->waiting = 0;
}

/* --- The controller's errors --- */

/* Reports a changed state. A bus-off controller drops its frames; recovery takes 128 times eleven recessive bits. */
static void update_status(fmu_side *side)
{
    sw_bus_health *health = &side->health;
    uint8_t status = health->tx_errors > 127 || health->rx_errors > 127 ? ERROR_PASSIVE : ERROR_ACTIVE;
    if (health->tx_errors > 255 || health->is_bus_off) status = BUS_OFF;
    if (status == side->status) return;
    if (status == BUS_OFF) {
        health->is_bus_off = 1;
        health->bus_off += 1;
        side->off_until_ns = side->reached_ns + INT64_C(128) * 11 * 1000000000 / SW_FMU_NOMINAL_BITRATE;
        side->waiting = 0;
        side->tx_bytes = 0;
    }
    side->status = status;
    uint8_t *place = put_operation(side, STATUS_OPERATION, 1);
    if (place != NULL) place[0] = status;
}

static void recover(fmu_side *side, int64_t now_ns)
{
    if (!side->health.is_bus_off || now_ns < side->off_until_ns) return;
    side->health.is_bus_off = 0;
    side->health.tx_errors = 0;
    side->health.rx_errors = 0;
    update_status(side);
}

/* Repeats the frames with this identifier, unless frames of the next step are already waiting. */
static void repeat(fmu_side *side, uint32_t id)
{
    if (side->waiting > 0 || side->health.is_bus_off) return;
    for (int i = 0; i < SW_FRAMES_OUT; i++) {
        if (side->answers[i].length > 0 && side->answers[i].id == id) put_frame(side, &side->answers[i]);
    }
}

static void count_error(fmu_side *side, const uint8_t *arguments)
{
    sw_bus_health *health = &side->health;
    const int is_passive = side->status == ERROR_PASSIVE;
    if (health->is_bus_off) return;
    if (arguments[6] != 0) {
        /* An error-passive controller does not count a missing acknowledgement. */
        if (!(is_passive && arguments[4] == ACK_ERROR)) health->tx_errors += 8;
    } else {
        health->rx_errors += arguments[5] == PRIMARY ? 9 : 1;
        if (health->rx_errors > 255) health->rx_errors = 255;
    }
    update_status(side);
    if (arguments[6] != 0) repeat(side, number_at(arguments, 4));
}

/* --- Operations received --- */

static int is_bool(uint8_t value) { return value <= 1; }

static int is_length(uint32_t length, int is_fd)
{
    const int is_coded = length <= 24 ? length % 4 == 0 : length == 32 || length == 48 || length == 64;
    return length <= 8 || (is_fd && is_coded);
}

/* Processes a frame from another node, with `bytes` bytes of arguments. Returns 0 if such a frame cannot exist. */
static int take_frame(fmu_side *side, const uint8_t *arguments, uint32_t bytes, int is_fd)
{
    const uint32_t before = is_fd ? 9 : 8;
    if (bytes < before) return 0;
    const uint32_t id = number_at(arguments, 4), length = number_at(arguments + before - 2, 2);
    if (bytes != before + length || !is_length(length, is_fd)) return 0;
    if (!is_bool(arguments[4]) || !is_bool(arguments[5]) || (is_fd && !is_bool(arguments[6]))) return 0;
    if (id > (arguments[4] ? 0x1fffffffu : 0x7ffu)) return 0;
    /* A bus-off controller receives nothing. A classic CAN controller ignores CAN FD. Remote frames have no data. */
    if (side->health.is_bus_off || (is_fd && !SW_FRAMES_FD) || (!is_fd && arguments[5])) return 1;
    uint32_t *errors = &side->health.rx_errors;
    if (*errors > 0) *errors = *errors > 127 ? 127 : *errors - 1;
    update_status(side);
    if (side->received >= FMU_MOST_FRAMES) return 1; /* the new frame is lost */
    sw_frame *frame = &side->frames[side->received++];
    (void)memset(frame, 0, sizeof *frame);
    frame->timestamp_ns = side->reached_ns;
    frame->id = id;
    frame->is_extended = arguments[4];
    frame->is_fd = (uint8_t)is_fd;
    frame->length = (uint8_t)length;
    (void)memcpy(frame->data, arguments + before, length);
    return 1;
}

/* Processes an operation; returns 0 if its format is wrong. */
static int take_operation(fmu_memory *kept, uint32_t code, const uint8_t *arguments, uint32_t bytes)
{
    fmu_side *side = &kept->side;
    const int is_notified = kept->values[SW_FMU_BUS_NOTIFICATIONS] != 0.0;
    switch (code) {
    case CAN_TRANSMIT:
    case FD_TRANSMIT: return take_frame(side, arguments, bytes, code == FD_TRANSMIT);
    case XL_TRANSMIT: return bytes >= 14 && bytes == 14 + number_at(arguments + 12, 2);
    case CONFIRM:
        if (bytes != 4) return 0;
        if (is_notified && side->health.tx_errors > 0 && !side->health.is_bus_off) side->health.tx_errors -= 1;
        update_status(side);
        return 1;
    case ARBITRATION_LOST:
        if (bytes != 4) return 0;
        if (is_notified) repeat(side, number_at(arguments, 4));
        return 1;
    case BUS_ERROR:
        if (bytes != 7 || arguments[4] < BIT_ERROR || arguments[4] > BROKEN_ERROR_FRAME) return 0;
        if (arguments[5] < PRIMARY || arguments[5] > SECONDARY || !is_bool(arguments[6])) return 0;
        if (is_notified) count_error(side, arguments);
        return 1;
    case STATUS_OPERATION: return bytes == 1;
    case WAKEUP: return bytes == 0;
    case CONFIGURATION: return bytes >= 2;
    case FORMAT_ERROR: return 1; /* no answer, so that two nodes do not report format errors to each other endlessly */
    default: return 0;
    }
}

/* Processes all operations. After an operation with a wrong length, further operations cannot be read. */
void fmu_take_operations(fmu_memory *kept)
{
    fmu_side *side = &kept->side;
    uint32_t length = 0;
    for (uint32_t at = 0; at < side->rx_bytes; at += length) {
        const uint8_t *operation = side->rx + at;
        const uint32_t rest = side->rx_bytes - at;
        length = rest < HEADER ? 0 : number_at(operation + 4, 4);
        if (length < HEADER || length > rest) length = rest;
        if (rest < HEADER || number_at(operation + 4, 4) != length ||
            !take_operation(kept, number_at(operation, 4), operation + HEADER, length - HEADER)) {
            put_format_error(side, operation, length);
        }
    }
}

/* --- The side of the ECU --- */

static int64_t ns_of(double seconds) { return (int64_t)(seconds * 1e9 + 0.5); }

fmi3String fmu_begun(fmu_memory *kept)
{
    fmu_side *side = &kept->side;
    const double offset = kept->values[SW_FMU_STEP_OFFSET] * 1e9, takes = kept->values[SW_FMU_COMPUTE_TIME] * 1e9;
    if (!(offset >= 0.0 && offset < (double)SW_PERIOD_NS)) return "step_offset: must be in 0 s..a control period";
    if (!(takes >= 0.0 && takes < (double)SW_PERIOD_NS)) return "compute_time: must be in 0 s..a control period";
    kept->next_ns = ns_of(kept->values[SW_FMU_STEP_OFFSET]);
    side->status = ERROR_ACTIVE;
    put_configuration(side, CAN_BAUDRATE, SW_FMU_NOMINAL_BITRATE, 4);
    if (SW_FRAMES_FD) put_configuration(side, FD_BAUDRATE, SW_FMU_DATA_BITRATE, 4);
    put_configuration(side, ARBITRATION_LOST_BEHAVIOUR, BUFFER_AND_RETRANSMIT, 1);
    return NULL;
}

/* Returns the largest difference in ns between two times that count as equal: 100 ns, which is less than a bit at
 * 8 Mbit/s, plus the rounding error of the start time in s (a double, so 2^-53 of the time).
 */
static double same_ns(const fmu_memory *kept)
{
    return 100.0 + 1.2e-7 * (kept->start < 0.0 ? -kept->start : kept->start);
}

int fmu_is_due(const fmu_memory *kept, double until_ns) { return (double)kept->next_ns <= until_ns + same_ns(kept); }

int fmu_received(fmu_memory *kept, sw_frame frames[FMU_MOST_FRAMES], sw_surroundings *around)
{
    fmu_side *side = &kept->side;
    const int count = side->received;
    recover(side, kept->next_ns);
    around->health = side->health;
    (void)memcpy(frames, side->frames, (size_t)count * sizeof *frames);
    side->received = 0;
    return count;
}

void fmu_sent(fmu_memory *kept, const sw_frame *frames, int count)
{
    fmu_side *side = &kept->side;
    put_answers(side); /* sends the previous step's frames if two steps are in one communication step */
    if (side->health.is_bus_off) return;
    (void)memcpy(side->answers, frames, (size_t)count * sizeof *frames);
    side->waiting = count;
    side->answer_ns = kept->next_ns + ns_of(kept->values[SW_FMU_COMPUTE_TIME]);
}

int fmu_reached(fmu_instance *fmu, double until_ns)
{
    fmu_side *side = &fmu->kept.side;
    side->reached_ns = (int64_t)(until_ns + 0.5);
    recover(side, side->reached_ns);
    const double latest_ns = (double)side->reached_ns + same_ns(&fmu->kept);
    if (side->waiting > 0 && (double)side->answer_ns <= latest_ns) put_answers(side);
    if (!fmu->has_event_mode) {
        side->tx_bytes = 0; /* no bus is connected */
    } else if (side->has_lost) {
        if (fmu->logger.log != NULL) {
            fmu->logger.log(fmu->logger.environment, fmi3Warning, "logStatusWarning",
                            "Tx_Clock has not ticked for long: Tx_Data is full, and frames are lost");
        }
        side->has_lost = 0;
    }
    return side->tx_bytes > 0;
}

int fmu_is_possible(const fmu_side *side)
{
    int is_possible = side->rx_bytes <= RX_BYTES && side->tx_bytes <= TX_BYTES && side->waiting >= 0 &&
                      side->waiting <= SW_FRAMES_OUT && side->received >= 0 && side->received <= FMU_MOST_FRAMES;
    for (int i = 0; is_possible && i < side->received; i++) is_possible = side->frames[i].length <= SW_FRAME_BYTES;
    for (int i = 0; is_possible && i < SW_FRAMES_OUT; i++) is_possible = side->answers[i].length <= SW_FRAME_BYTES;
    return is_possible;
}

uint64_t fmu_interval_ns(const fmu_memory *kept)
{
    const fmu_side *side = &kept->side;
    int64_t at = kept->next_ns + ns_of(kept->values[SW_FMU_COMPUTE_TIME]);
    if (side->waiting > 0) at = side->answer_ns;
    return side->tx_bytes > 0 || at < side->reached_ns ? 0 : (uint64_t)(at - side->reached_ns);
}
