/* What a tester reads of the store: the twin of can_bridge/flashing/report.py, which has the layout. */
#include "sw_store_parts.h"

#define HEAD 18u
#define SLOT 49u /* bytes of one, before its name */

uint32_t sw_store_report(const sw_store *store, uint8_t *data)
{
    static const uint8_t magic[4] = {'S', 'W', 'T', '1'};
    const sw_store_state *state = &store->state;
    uint32_t at = HEAD;
    sw_bytes_copy(data, magic, 4);
    data[4] = store->running;
    data[5] = state->active;
    data[6] = (uint8_t)sw_state_next_boot(state);
    data[7] = store->reason;
    sw_put_big_u32(&data[8], state->least_security_version);
    sw_put_big_u32(&data[12], sw_key_list_version(store->keys));
    sw_bytes_copy(&data[16], state->attempts, 2);
    for (uint32_t i = 0; i < 2u; i++) {
        const sw_slot_state *slot = &state->slots[i];
        data[at] = slot->phase;
        data[at + 1u] = store->verdicts[i];
        data[at + 2u] = slot->boots_left;
        data[at + 3u] = 0;
        data[at + 4u] = slot->facts.name_length;
        sw_put_big_u32(&data[at + 5u], slot->facts.security_version);
        sw_put_big_u32(&data[at + 9u], slot->received);
        sw_put_big_u32(&data[at + 13u], slot->length);
        sw_bytes_copy(&data[at + 17u], slot->facts.digest, 32);
        sw_bytes_copy(&data[at + SLOT], slot->facts.name, slot->facts.name_length);
        at += SLOT + slot->facts.name_length;
    }
    return at;
}
