/* The measurement list of DAQ (allocation, entries and start of the list), and the packets of a period. */
#include "sw_daq.h"

#if SW_XCP

#include "sw_ecu_parts.h"

/* Stages of the allocation, in the order of its commands. */
enum { NOTHING, FREED, LISTS, ODTS, ENTRIES };

#define MOST_IN_ODT (SW_XCP_MAX_CTO - 1u)
#define NO_BITS 0xffu
#define STOP 0u /* modes of START_STOP_DAQ_LIST and of START_STOP_SYNCH */
#define START 1u
#define SELECT 2u
#define STOP_SELECTED 2u
#define SELECTED 0x01u /* bits of a list's mode */
#define RUNNING 0x40u

void sw_daq_free(sw_daq *daq)
{
    daq->stage = NOTHING;
    daq->lists = 0;
    daq->odts = 0;
    daq->used = 0;
    daq->has_pointer = 0;
    daq->is_selected = 0;
    daq->is_running = 0;
    daq->next = 0;
}

/* --- The control period --- */

/* Returns the correction of the speed in thousandths, rounded and limited to +-127. */
static int8_t thousandths_of(const sw_ecu *ecu)
{
#if SW_PAST > 0 && SW_AIR_SPEED
    const double exact = (ecu->state.speed.air.correction - 1.0) * 1000.0;
    const int rounded = (int)(exact + (exact < 0.0 ? -0.5 : 0.5));
    return (int8_t)(rounded > 127 ? 127 : (rounded < -127 ? -127 : rounded));
#else
    (void)ecu;
    return 0;
#endif
}

void sw_daq_sample(sw_daq *daq, const sw_ecu *ecu, uint8_t mode)
{
    sw_measured *measured = &daq->measured;
    if (daq->next < daq->odts) return;
    for (int i = 0; i < SW_SENSORS; i++) measured->pressures[i] = (float)ecu->state.memory.window[SW_WINDOW - 1][i];
    measured->command = (float)ecu->trace.action;
    measured->mode = mode;
    measured->reason = ecu->state.fail_safe.reason;
    measured->gated = ecu->trace.interventions;
    measured->correction = thousandths_of(ecu);
    measured->calibration = ecu->calibration;
    if (daq->is_running) daq->next = 0;
}

uint32_t sw_daq_packet(sw_daq *daq, uint8_t *packet)
{
    const uint8_t *bytes = (const uint8_t *)&daq->measured;
    uint32_t length = 0;
    while (length <= 1u && daq->next < daq->odts) {
        const sw_daq_entry *entries = &daq->entries[daq->first[daq->next]];
        packet[0] = daq->next;
        length = 1;
        for (uint32_t i = 0; i < daq->count[daq->next]; i++) {
            sw_bytes_copy(&packet[length], &bytes[entries[i].at], entries[i].bytes);
            length += entries[i].bytes;
        }
        daq->next++;
    }
    return length > 1u ? length : 0u;
}

/* --- The list --- */

static uint32_t number(const uint8_t *data) { return data[0] | (uint32_t)data[1] << 8; }

static void stop(sw_daq *daq)
{
    daq->is_running = 0;
    daq->next = daq->odts;
}

static uint8_t alloc_lists(sw_daq *daq, const uint8_t *data)
{
    const uint32_t count = number(&data[2]);
    if (daq->stage != FREED && daq->stage != LISTS) return SW_XCP_ERROR_SEQUENCE;
    if (count > 1u) return SW_XCP_ERROR_MEMORY_OVERFLOW;
    daq->stage = LISTS;
    daq->lists = (uint8_t)count;
    return SW_XCP_DONE;
}

static uint8_t alloc_odts(sw_daq *daq, const uint8_t *data)
{
    if (daq->stage != LISTS && daq->stage != ODTS) return SW_XCP_ERROR_SEQUENCE;
    if (number(&data[2]) >= daq->lists || data[4] == 0u) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (data[4] > SW_XCP_ODTS) return SW_XCP_ERROR_MEMORY_OVERFLOW;
    daq->stage = ODTS;
    daq->odts = data[4];
    daq->next = daq->odts;
    for (uint32_t i = 0; i < SW_XCP_ODTS; i++) daq->count[i] = 0;
    return SW_XCP_DONE;
}

static uint8_t alloc_entries(sw_daq *daq, const uint8_t *data)
{
    const uint32_t odt = data[4];
    const uint32_t count = data[5];
    if (daq->stage != ODTS && daq->stage != ENTRIES) return SW_XCP_ERROR_SEQUENCE;
    if (number(&data[2]) >= daq->lists || odt >= daq->odts || count == 0u) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (daq->count[odt] > 0u) return SW_XCP_ERROR_SEQUENCE;
    if (daq->used + count > SW_XCP_ENTRIES) return SW_XCP_ERROR_MEMORY_OVERFLOW;
    daq->stage = ENTRIES;
    daq->first[odt] = daq->used;
    daq->count[odt] = (uint8_t)count;
    for (uint32_t i = 0; i < count; i++) daq->entries[daq->used + i].bytes = 0;
    daq->used = (uint8_t)(daq->used + count);
    return SW_XCP_DONE;
}

static uint8_t set_pointer(sw_daq *daq, const uint8_t *data)
{
    if (daq->is_running) return SW_XCP_ERROR_DAQ_ACTIVE;
    if (number(&data[2]) >= daq->lists || data[4] >= daq->odts) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (data[5] >= daq->count[data[4]]) return SW_XCP_ERROR_OUT_OF_RANGE;
    daq->has_pointer = 1;
    daq->odt = data[4];
    daq->entry = data[5];
    return SW_XCP_DONE;
}

/* Returns the total length in bytes of all entries of the ODT except the entry at the tool's pointer. */
static uint32_t beside(const sw_daq *daq)
{
    uint32_t bytes = 0;
    for (uint32_t i = 0; i < daq->count[daq->odt]; i++) {
        if (i != daq->entry) bytes += daq->entries[daq->first[daq->odt] + i].bytes;
    }
    return bytes;
}

static uint8_t write_entry(sw_daq *daq, const uint8_t *data)
{
    const uint32_t bytes = data[2];
    const uint32_t address = number(&data[4]) | number(&data[6]) << 16;
    const uint32_t at = address - SW_XCP_MEASURED;
    if (daq->is_running) return SW_XCP_ERROR_DAQ_ACTIVE;
    if (!daq->has_pointer || daq->entry >= daq->count[daq->odt]) return SW_XCP_ERROR_SEQUENCE;
    if (data[1] != NO_BITS || bytes == 0u || bytes > MOST_IN_ODT || data[3] != 0u) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (address < SW_XCP_MEASURED || at > sizeof(sw_measured) - bytes) return SW_XCP_ERROR_ACCESS_DENIED;
    if (beside(daq) + bytes > MOST_IN_ODT) return SW_XCP_ERROR_DAQ_CONFIG;
    sw_daq_entry *entry = &daq->entries[daq->first[daq->odt] + daq->entry];
    entry->at = (uint8_t)at;
    entry->bytes = (uint8_t)bytes;
    daq->entry++;
    return SW_XCP_DONE;
}

static uint8_t set_mode(const sw_daq *daq, const uint8_t *data)
{
    if (daq->is_running) return SW_XCP_ERROR_DAQ_ACTIVE;
    if (data[1] != 0u) return SW_XCP_ERROR_MODE_NOT_VALID;
    const int is_there = number(&data[2]) < daq->lists && number(&data[4]) == 0u && data[6] == 1u;
    return is_there ? SW_XCP_DONE : SW_XCP_ERROR_OUT_OF_RANGE;
}

static uint8_t get_mode(const sw_daq *daq, const uint8_t *data, sw_answer *answer)
{
    static const uint8_t plain[] = {0, 0, 0, 0, 1, 0}; /* event 0, prescaler 1 */
    if (number(&data[2]) >= daq->lists) return SW_XCP_ERROR_OUT_OF_RANGE;
    sw_answer_byte(answer, (daq->is_selected ? SELECTED : 0u) | (daq->is_running ? RUNNING : 0u));
    sw_answer_bytes(answer, plain, sizeof plain);
    return SW_XCP_DONE;
}

static uint8_t start_stop(sw_daq *daq, const uint8_t *data, sw_answer *answer)
{
    if (number(&data[2]) >= daq->lists) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (data[1] > SELECT) return SW_XCP_ERROR_MODE_NOT_VALID;
    if (data[1] != STOP && daq->odts == 0u) return SW_XCP_ERROR_DAQ_CONFIG;
    if (data[1] == STOP) stop(daq);
    if (data[1] == START) daq->is_running = 1;
    if (data[1] == SELECT) daq->is_selected = 1;
    sw_answer_byte(answer, 0); /* the number of the first ODT */
    return SW_XCP_DONE;
}

static uint8_t start_stop_selected(sw_daq *daq, const uint8_t *data)
{
    if (data[1] > STOP_SELECTED) return SW_XCP_ERROR_MODE_NOT_VALID;
    if (data[1] == STOP || (data[1] == STOP_SELECTED && daq->is_selected)) stop(daq);
    if (data[1] == START && daq->is_selected) daq->is_running = 1;
    daq->is_selected = 0;
    return SW_XCP_DONE;
}

/* --- Properties --- */

static uint8_t processor_info(const sw_daq *daq, sw_answer *answer)
{
    const uint8_t info[] = {SW_XCP_DAQ_PROPERTIES, daq->lists, 0, 1, 0, 0, 0};
    sw_answer_bytes(answer, info, sizeof info);
    return SW_XCP_DONE;
}

static uint8_t resolution_info(sw_answer *answer)
{
    static const uint8_t info[] = {1, MOST_IN_ODT, 1, 0, 0, 0, 0};
    sw_answer_bytes(answer, info, sizeof info);
    return SW_XCP_DONE;
}

static uint8_t event_info(const uint8_t *data, sw_answer *answer)
{
    static const uint8_t info[] = {
        SW_XCP_EVENT_PROPERTIES, 1, sizeof(SW_XCP_EVENT_NAME) - 1u, SW_XCP_CYCLE, SW_XCP_CYCLE_UNIT, 0,
    };
    if (number(&data[2]) != 0u) return SW_XCP_ERROR_OUT_OF_RANGE;
    sw_answer_bytes(answer, info, sizeof info);
    return SW_XCP_DONE;
}

uint8_t sw_daq_command(sw_daq *daq, const uint8_t *data, sw_answer *answer)
{
    uint8_t code = SW_XCP_DONE;
    switch (data[0]) {
    case SW_XCP_FREE_DAQ:
        sw_daq_free(daq);
        daq->stage = FREED;
        break;
    case SW_XCP_ALLOC_DAQ:
        code = alloc_lists(daq, data);
        break;
    case SW_XCP_ALLOC_ODT:
        code = alloc_odts(daq, data);
        break;
    case SW_XCP_ALLOC_ODT_ENTRY:
        code = alloc_entries(daq, data);
        break;
    case SW_XCP_SET_DAQ_PTR:
        code = set_pointer(daq, data);
        break;
    case SW_XCP_WRITE_DAQ:
        code = write_entry(daq, data);
        break;
    case SW_XCP_SET_DAQ_LIST_MODE:
        code = set_mode(daq, data);
        break;
    case SW_XCP_GET_DAQ_LIST_MODE:
        code = get_mode(daq, data, answer);
        break;
    case SW_XCP_START_STOP_DAQ_LIST:
        code = start_stop(daq, data, answer);
        break;
    case SW_XCP_START_STOP_SYNCH:
        code = start_stop_selected(daq, data);
        break;
    case SW_XCP_GET_DAQ_PROCESSOR_INFO:
        code = processor_info(daq, answer);
        break;
    case SW_XCP_GET_DAQ_RESOLUTION_INFO:
        code = resolution_info(answer);
        break;
    case SW_XCP_GET_DAQ_EVENT_INFO:
        code = event_info(data, answer);
        break;
    default:
        code = SW_XCP_ERROR_CMD_UNKNOWN;
        break;
    }
    return code;
}

#endif
