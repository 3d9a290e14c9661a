/* Counts the basic blocks that an emulated core executes: a hook of Unicorn's, called some million times a step. It runs
 * on this machine, inside the emulator.
 */
#include <stdint.h>

typedef struct {
    uint64_t origin; /* of the memory with the code */
    uint64_t places; /* half-words of it */
    uint64_t *counts; /* of blocks that begin at a half-word */
    uint32_t *sizes;  /* bytes of the latest one there */
} block_counts;

void count_block(void *core, uint64_t address, uint32_t size, void *counts);

void count_block(void *core, uint64_t address, uint32_t size, void *counts)
{
    block_counts *const found = counts;
    const uint64_t place = (address - found->origin) / 2;
    (void)core;
    if (place < found->places) {
        found->counts[place]++;
        found->sizes[place] = size;
    }
}
