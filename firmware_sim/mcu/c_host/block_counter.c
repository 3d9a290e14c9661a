/* Counts the basic blocks that an emulated core executes. Unicorn calls this hook about a million times per control
 * step. The hook runs on the host, inside the emulator.
 */
#include <stdint.h>

typedef struct {
    uint64_t origin; /* first address of the memory with the code */
    uint64_t places; /* number of half-words in this memory */
    uint64_t *counts; /* for each half-word: number of executions of the blocks that begin there */
    uint32_t *sizes;  /* for each half-word: length in bytes of the latest block that began there */
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
