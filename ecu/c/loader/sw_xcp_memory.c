/* The memory that a calibration tool reads and writes, and its two pages. */
#include "sw_xcp_memory.h"

#if SW_XCP

#include "sw_records.h"

static int is_inside(uint32_t address, uint32_t length, uint32_t start, uint32_t size)
{
    return address >= start && address - start <= size && length <= size - (address - start);
}

/* Copies at most sizeof(sw_measured) bytes from an address in the memory that the tool sees. */
static uint8_t read(const sw_xcp_memory *memory, uint32_t address, uint32_t length, uint8_t *bytes)
{
    if (is_inside(address, length, SW_XCP_MEASURED, sizeof(sw_measured))) {
        sw_bytes_copy(bytes, &((const uint8_t *)&memory->daq->measured)[address - SW_XCP_MEASURED], length);
        return SW_XCP_DONE;
    }
    if (!is_inside(address, length, SW_XCP_ADDRESS, sizeof(sw_calibration))) return SW_XCP_ERROR_ACCESS_DENIED;
    sw_calibrating_bytes(memory->calibrating, memory->page, address - SW_XCP_ADDRESS, length, bytes);
    return SW_XCP_DONE;
}

void sw_xcp_memory_text(sw_xcp_memory *memory, const char *text, uint32_t bytes)
{
    memory->text = text;
    memory->text_bytes = (uint8_t)bytes;
}

static uint8_t get_id(sw_xcp_memory *memory, const uint8_t *data, sw_answer *answer)
{
    static const char name[] = SW_XCP_A2L_NAME;
    sw_xcp_memory_text(memory, name, data[1] <= 1u ? sizeof name - 1u : 0u); /* 0: text, 1: file name */
    for (uint32_t i = 0; i < 3u; i++) sw_answer_byte(answer, 0);
    sw_answer_little_u32(answer, memory->text_bytes);
    return SW_XCP_DONE;
}

static uint8_t set_mta(sw_xcp_memory *memory, const uint8_t *data)
{
    if (data[3] != 0u) return SW_XCP_ERROR_OUT_OF_RANGE;
    memory->address = sw_little_u32(&data[4]);
    memory->text_bytes = 0;
    return SW_XCP_DONE;
}

static int is_length(uint32_t length, uint32_t most) { return length > 0u && length <= most; }

static uint8_t upload(sw_xcp_memory *memory, const uint8_t *data, sw_answer *answer)
{
    uint8_t bytes[SW_XCP_MAX_CTO];
    const uint32_t length = data[1];
    if (!is_length(length, SW_XCP_MAX_CTO - 1u)) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (memory->text_bytes > 0u) {
        const uint32_t piece = length < memory->text_bytes ? length : memory->text_bytes;
        for (uint32_t i = 0; i < piece; i++) sw_answer_byte(answer, (uint8_t)memory->text[i]);
        sw_xcp_memory_text(memory, &memory->text[piece], memory->text_bytes - piece);
        return SW_XCP_DONE;
    }
    const uint8_t code = read(memory, memory->address, length, bytes);
    if (code != SW_XCP_DONE) return code;
    sw_answer_bytes(answer, bytes, length);
    memory->address += length;
    return SW_XCP_DONE;
}

static uint8_t short_upload(sw_xcp_memory *memory, const uint8_t *data, sw_answer *answer)
{
    uint8_t bytes[SW_XCP_MAX_CTO];
    const uint32_t length = data[1];
    const uint32_t address = sw_little_u32(&data[4]);
    if (!is_length(length, SW_XCP_MAX_CTO - 1u) || data[3] != 0u) return SW_XCP_ERROR_OUT_OF_RANGE;
    const uint8_t code = read(memory, address, length, bytes);
    if (code != SW_XCP_DONE) return code;
    sw_answer_bytes(answer, bytes, length);
    memory->text_bytes = 0;
    memory->address = address + length;
    return SW_XCP_DONE;
}

static uint8_t build_checksum(sw_xcp_memory *memory, const uint8_t *data, sw_answer *answer)
{
    uint8_t bytes[sizeof(sw_measured)];
    const uint32_t length = sw_little_u32(&data[4]);
    const uint8_t code = read(memory, memory->address, length, bytes);
    if (code != SW_XCP_DONE) return code;
    sw_answer_byte(answer, SW_XCP_CRC_32);
    sw_answer_byte(answer, 0);
    sw_answer_byte(answer, 0);
    sw_answer_little_u32(answer, sw_crc32(0, bytes, length));
    memory->address += length;
    return SW_XCP_DONE;
}

static uint8_t download(sw_xcp_memory *memory, const uint8_t *data, uint32_t length)
{
    const uint32_t count = data[1];
    if (!is_length(count, SW_XCP_MAX_CTO - 2u)) return SW_XCP_ERROR_OUT_OF_RANGE;
    if (length < 2u + count) return SW_XCP_ERROR_CMD_SYNTAX;
    if (!is_inside(memory->address, count, SW_XCP_ADDRESS, sizeof(sw_calibration))) return SW_XCP_ERROR_ACCESS_DENIED;
    if (memory->page != SW_PAGE_WORKING) return SW_XCP_ERROR_WRITE_PROTECTED;
    if (!sw_calibrating_write_bytes(memory->calibrating, memory->address - SW_XCP_ADDRESS, &data[2], count)) {
        return SW_XCP_ERROR_OUT_OF_RANGE;
    }
    memory->address += count;
    return SW_XCP_DONE;
}

/* --- Pages --- */

static uint8_t segment_refusal(uint32_t segment)
{
    return segment == 0u ? SW_XCP_DONE : SW_XCP_ERROR_SEGMENT_NOT_VALID;
}

static uint8_t page_refusal(uint32_t page)
{
    return page <= SW_PAGE_REFERENCE ? SW_XCP_DONE : SW_XCP_ERROR_PAGE_NOT_VALID;
}

static uint8_t set_page(sw_xcp_memory *memory, const uint8_t *data)
{
    const uint32_t mode = data[1];
    uint8_t code = SW_XCP_DONE;
    if ((mode & (SW_XCP_ECU_MODE | SW_XCP_XCP_MODE)) == 0u) return SW_XCP_ERROR_MODE_NOT_VALID;
    if ((mode & SW_XCP_ALL_MODE) == 0u) code = segment_refusal(data[2]);
    if (code == SW_XCP_DONE) code = page_refusal(data[3]);
    if (code != SW_XCP_DONE) return code;
    if ((mode & SW_XCP_ECU_MODE) != 0u) sw_calibrating_select(memory->calibrating, data[3]);
    if ((mode & SW_XCP_XCP_MODE) != 0u) memory->page = data[3];
    return SW_XCP_DONE;
}

static uint8_t get_page(const sw_xcp_memory *memory, const uint8_t *data, sw_answer *answer)
{
    if (data[1] != SW_XCP_ECU_MODE && data[1] != SW_XCP_XCP_MODE) return SW_XCP_ERROR_MODE_NOT_VALID;
    const uint8_t code = segment_refusal(data[2]);
    if (code != SW_XCP_DONE) return code;
    sw_answer_byte(answer, 0);
    sw_answer_byte(answer, 0);
    sw_answer_byte(answer, data[1] == SW_XCP_ECU_MODE ? memory->calibrating->page : memory->page);
    return SW_XCP_DONE;
}

static uint8_t segment_info(const uint8_t *data, sw_answer *answer)
{
    static const uint8_t pages[] = {SW_PAGE_REFERENCE + 1u, 0, 0, 0, 0};
    const uint8_t code = segment_refusal(data[2]);
    if (code != SW_XCP_DONE) return code;
    if (data[1] == 0u && data[3] <= 1u) {
        for (uint32_t i = 0; i < 3u; i++) sw_answer_byte(answer, 0);
        sw_answer_little_u32(answer, data[3] == 0u ? SW_XCP_ADDRESS : (uint32_t)sizeof(sw_calibration));
        return SW_XCP_DONE;
    }
    if (data[1] != 1u) return SW_XCP_ERROR_OUT_OF_RANGE;
    sw_answer_bytes(answer, pages, sizeof pages);
    return SW_XCP_DONE;
}

static uint8_t page_info(const uint8_t *data, sw_answer *answer)
{
    uint8_t code = segment_refusal(data[2]);
    if (code == SW_XCP_DONE) code = page_refusal(data[3]);
    if (code != SW_XCP_DONE) return code;
    sw_answer_byte(answer, data[3] == SW_PAGE_WORKING ? SW_XCP_WORKING_PROPERTIES : SW_XCP_REFERENCE_PROPERTIES);
    sw_answer_byte(answer, 0);
    return SW_XCP_DONE;
}

static uint8_t copy_page(sw_xcp_memory *memory, const uint8_t *data)
{
    uint8_t code = segment_refusal(data[1]);
    if (code == SW_XCP_DONE) code = segment_refusal(data[3]);
    if (code == SW_XCP_DONE) code = page_refusal(data[2]);
    if (code == SW_XCP_DONE) code = page_refusal(data[4]);
    if (code != SW_XCP_DONE) return code;
    if (data[4] == SW_PAGE_REFERENCE) return SW_XCP_ERROR_WRITE_PROTECTED;
    if (data[2] == SW_PAGE_REFERENCE) sw_calibrating_copy_release(memory->calibrating);
    return SW_XCP_DONE;
}

static uint8_t page_processor_info(sw_answer *answer)
{
    sw_answer_byte(answer, 1); /* one segment, without properties */
    sw_answer_byte(answer, 0);
    return SW_XCP_DONE;
}

uint8_t sw_xcp_memory_command(sw_xcp_memory *memory, const uint8_t *data, uint32_t length, sw_answer *answer)
{
    uint8_t code = SW_XCP_DONE;
    switch (data[0]) {
    case SW_XCP_GET_ID:
        code = get_id(memory, data, answer);
        break;
    case SW_XCP_SET_MTA:
        code = set_mta(memory, data);
        break;
    case SW_XCP_UPLOAD:
        code = upload(memory, data, answer);
        break;
    case SW_XCP_SHORT_UPLOAD:
        code = short_upload(memory, data, answer);
        break;
    case SW_XCP_BUILD_CHECKSUM:
        code = build_checksum(memory, data, answer);
        break;
    case SW_XCP_DOWNLOAD:
        code = download(memory, data, length);
        break;
    case SW_XCP_SET_CAL_PAGE:
        code = set_page(memory, data);
        break;
    case SW_XCP_GET_CAL_PAGE:
        code = get_page(memory, data, answer);
        break;
    case SW_XCP_GET_PAG_PROCESSOR_INFO:
        code = page_processor_info(answer);
        break;
    case SW_XCP_GET_SEGMENT_INFO:
        code = segment_info(data, answer);
        break;
    case SW_XCP_GET_PAGE_INFO:
        code = page_info(data, answer);
        break;
    default:
        code = copy_page(memory, data);
        break;
    }
    return code;
}

void sw_xcp_memory_end(sw_xcp_memory *memory)
{
    memory->address = 0;
    memory->text_bytes = 0;
    memory->page = SW_PAGE_WORKING;
}

#endif
