/* Lives through the periods of a file again, for sanitisers and for coverage: twin_replay [compared] periods. */
#include <stdio.h>
#include <stdlib.h>

#include "twin.h"

int main(int argc, char **argv)
{
    static sw_ecu ecu;
    static twin_period period;
    static twin_response found;
    static uint8_t compared[sizeof(twin_response)];
    long number = 0;
    FILE *file = argc == 3 ? fopen(argv[1], "rb") : NULL;
    if (file == NULL || fread(compared, sizeof compared, 1, file) != 1) return EXIT_FAILURE;
    fclose(file);
    file = fopen(argv[2], "rb");
    if (file == NULL) return EXIT_FAILURE;
    while (fread(&period, sizeof period, 1, file) == 1) {
        if (twin_run(&ecu, &period, 1, compared, &found) != 1) {
            fprintf(stderr, "period %ld differs\n", number);
            return EXIT_FAILURE;
        }
        number++;
    }
    fclose(file);
    printf("%ld periods\n", number);
    return EXIT_SUCCESS;
}
