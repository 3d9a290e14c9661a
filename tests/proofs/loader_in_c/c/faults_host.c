/* A flash memory with any record of the fault memory. */
#include "node_host.h"

int host_keep_faults(host *of, const uint8_t *record, uint32_t length);

int host_keep_faults(host *of, const uint8_t *record, uint32_t length)
{
    return (int)sw_store_keep_faults(&of->node.store, record, length);
}
