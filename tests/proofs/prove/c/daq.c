/* The measurement of XCP: any command to the list, and any packet of it; what is sent lies in the measured values. */
#include "sw_uds_settings.h"
#undef SW_XCP_ODTS
#undef SW_XCP_ENTRIES
#define SW_XCP_ODTS 2u
#define SW_XCP_ENTRIES 3u

#include "bytes_model.h"

#include "sw_daq.c"

static int is_in(const sw_daq *daq, uint32_t odt, uint32_t entry)
{
    return odt < daq->odts && entry >= daq->first[odt] && entry < (uint32_t)daq->first[odt] + daq->count[odt];
}

static int is_sound(const sw_daq *daq)
{
    int sound = daq->lists <= 1u && daq->odts <= SW_XCP_ODTS && daq->used <= SW_XCP_ENTRIES && daq->stage <= ENTRIES;
    sound &= daq->next <= daq->odts && daq->odt < SW_XCP_ODTS && (daq->lists > 0u || daq->odts == 0u);
    sound &= daq->stage == ENTRIES || daq->stage == NOTHING || daq->used == 0u;
    sound &= daq->stage != NOTHING || daq->lists == 0u;
    sound &= daq->stage == ODTS || daq->stage == ENTRIES || daq->odts == 0u;
    sound &= !daq->has_pointer || (daq->stage == ENTRIES && daq->odt < daq->odts);
    for (uint32_t odt = 0; odt < SW_XCP_ODTS; odt++) {
        uint32_t bytes = 0;
        sound &= daq->first[odt] < SW_XCP_ENTRIES;
        if (odt >= daq->odts) continue;
        sound &= daq->count[odt] == 0u || daq->first[odt] + daq->count[odt] <= daq->used;
        for (uint32_t i = 0; i < SW_XCP_ENTRIES; i++) bytes += is_in(daq, odt, i) ? daq->entries[i].bytes : 0u;
        sound &= bytes <= MOST_IN_ODT;
    }
    for (uint32_t i = 0; i < SW_XCP_ENTRIES; i++) {
        sound &= !is_in(daq, 0, i) || !is_in(daq, 1, i); /* none is of two packets */
        sound &= daq->entries[i].bytes <= MOST_IN_ODT && daq->entries[i].at + daq->entries[i].bytes <= sizeof(sw_measured);
    }
    return sound;
}

void any_list(void)
{
    sw_daq daq;
    uint8_t data[SW_XCP_MAX_CTO], bytes[SW_XCP_MAX_CTO];
    sw_answer answer = {bytes, sizeof bytes, 1};
    ASSUME(is_sound(&daq));
    (void)sw_daq_command(&daq, data, &answer);
    PROVE(is_sound(&daq) && answer.length <= SW_XCP_MAX_CTO);
}

void any_packet(void)
{
    sw_daq daq;
    uint8_t packet[SW_XCP_MAX_CTO];
    ASSUME(is_sound(&daq));
    const uint32_t length = sw_daq_packet(&daq, packet);
    PROVE(length <= SW_XCP_MAX_CTO && is_sound(&daq));
}
