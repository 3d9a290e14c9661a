/* Lives through the periods of a file again, for sanitisers and for coverage: twin_replay compared periods.
 *
 * Before that, what no period leads to, because another part has refused it already.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sw_ecu_parts.h"
#include "twin.h"

static int is_shut(sw_gated gated, int why)
{
    return gated.flow_m2_per_s == 0.0 && !gated.enable && gated.interventions == why;
}

/* The gate by itself: it does not trust that plans are finite, nor that a wrong clock is a fault. */
static int gate_is_sound(void)
{
    const double wrong[] = {NAN, INFINITY, -INFINITY};
    const sw_gate_limits limits = {SW_GATE_FLOW, SW_GATE_STEP};
    int sound = 1;
    for (int i = 0; i < 3; i++) sound &= is_shut(sw_gate(wrong[i], 1, 0.0, 1, 0, 1, 1, 1, &limits), SW_GATED_NOT_FINITE);
    sound &= is_shut(sw_gate(0.0, 1, 0.0, 1, 5, 1, 5, 5, &limits), SW_GATED_CLOCK);
    sound &= is_shut(sw_gate(0.0, 1, 0.0, 1, 6, 1, 5, 5, &limits), SW_GATED_CLOCK);
    sound &= is_shut(sw_gate(0.0, 1, 0.0, 1, 0, 0, 0, 5, &limits), SW_GATED_STALE);
    return sound;
}

/* Values that no `Calibration` of Python can have: they are refused, and change nothing. */
static int calibration_is_sound(sw_ecu *ecu)
{
    sw_ecu before;
    int sound = 1;
    sw_ecu_init(ecu);
    for (int i = 0; i < SW_TERMS + 2; i++) {
        sw_calibration wrong = ecu->calibration;
        float *values[] = {&wrong.weights[i % SW_TERMS], &wrong.action_limit, &wrong.command_step};
        *values[i < SW_TERMS ? 0 : i - SW_TERMS + 1] = NAN;
        memcpy(&before, ecu, sizeof before);
        sound &= sw_ecu_calibrate(ecu, &wrong) == i + 1 && memcmp(&before, ecu, sizeof before) == 0;
    }
    return sound;
}

/* The codec and the protection by themselves: pressures with a time before 0, which no clock gives, are stale. */
static int reception_is_sound(void)
{
    sw_receiver receiver;
    sw_received received;
    sw_frame frame;
    memset(&receiver, 0, sizeof receiver);
    memset(&frame, 0, sizeof frame);
    receiver.stream = SW_NODATA;
    frame.id = SW_PRESSURE_ID;
    frame.length = SW_PRESSURE_BYTES;
    frame.timestamp_ns = -1;
#if SW_SECOC
    sw_secoc secoc;
    sw_freshness freshness = {1, 1};
    const uint8_t key[SW_AES_BYTES] = {1};
    (void)sw_secoc_begin(&secoc, key);
    frame.length = SW_PRESSURE_SECURED;
#endif
    for (int i = 0; i < 2 * SW_E2E_WINDOW; i++) {
        sw_e2e_protect(frame.data, SW_PRESSURE_BYTES, SW_PRESSURE_DATA_ID, (uint8_t)(i % SW_E2E_COUNTERS));
#if SW_SECOC
        sw_secoc_secure(&secoc, frame.data, SW_PRESSURE_SECURED, SW_PRESSURE_DATA_ID, &freshness);
        sw_freshness_next(&freshness);
#endif
        sw_reception(&received, &receiver, &frame, 1, 0, SW_DYNAMIC_PRESSURE SW_BY_KEY(&secoc));
    }
    return receiver.stream == SW_VALID && !received.usable && received.unusable_because == SW_REASON_STALE;
}

/* Without a key nothing is sent and nothing believed, not even what memory of zeros would have computed. */
static int keyless_is_sound(sw_ecu *ecu)
{
    int sound = 1;
#if SW_SECOC
    const sw_authentication wrong[] = {{{0}, 1, 0, 0}, {{1}, 0, 0, 0}};
    sw_frame frame, sent[SW_FRAMES_OUT];
    for (int i = 0; i < 2; i++) {
        sw_ecu_init(ecu);
        memset(&frame, 0, sizeof frame);
        frame.id = SW_PRESSURE_ID;
        frame.length = SW_PRESSURE_SECURED;
        sound &= sw_ecu_authenticate(ecu, &wrong[i]) == 1;
        sw_secoc_secure(&ecu->secoc, frame.data, SW_PRESSURE_SECURED, SW_PRESSURE_DATA_ID, &ecu->state.freshness);
        sound &= sw_ecu_step(ecu, 1, &frame, 1, sent) == 0 && ecu->state.pressures.verifier.not_authentic == 1;
    }
#else
    (void)ecu;
#endif
    return sound;
}

/* A state with a damaged byte is refused, or it does no harm: the sanitisers see what it does in a period. */
static int damage_is_borne(sw_ecu *ecu, const twin_period *period)
{
    static const uint8_t damages[] = {0x01, 0x7f, 0x80, 0xff};
    static twin_stimulus stimulus;
    static twin_response found;
    long refused = 0;
    stimulus = period->stimulus;
    stimulus.restarts = 0;
    stimulus.calibrates = 0;
    for (size_t i = 0; i < 4 * sizeof(sw_ecu_state); i++) {
        sw_ecu_init(ecu);
        stimulus.before = ecu->state;
        ((uint8_t *)&stimulus.before)[i / 4] ^= damages[i % 4];
        refused += sw_ecu_restore(ecu, &stimulus.before);
        stimulus.loads = 1;
        twin_step(ecu, &stimulus, &found);
    }
    return refused > 0;
}

int main(int argc, char **argv)
{
    static sw_ecu ecu;
    static twin_period period;
    static twin_response found;
    static uint8_t compared[sizeof(twin_response)];
    long number = 0;
    if (!gate_is_sound() || !reception_is_sound() || !calibration_is_sound(&ecu) || !keyless_is_sound(&ecu)) {
        fprintf(stderr, "the gate, the reception, the calibration or the key by itself\n");
        return EXIT_FAILURE;
    }
    FILE *file = argc == 3 ? fopen(argv[1], "rb") : NULL;
    if (file == NULL || fread(compared, sizeof compared, 1, file) != 1) return EXIT_FAILURE;
    fclose(file);
    file = fopen(argv[2], "rb");
    if (file == NULL) return EXIT_FAILURE;
    sw_ecu_init(&ecu);
    while (fread(&period, sizeof period, 1, file) == 1) {
        if (twin_run(&ecu, &period, 1, compared, &found) != 1) {
            fprintf(stderr, "period %ld differs\n", number);
            return EXIT_FAILURE;
        }
        number++;
    }
    fclose(file);
    if (!damage_is_borne(&ecu, &period)) return EXIT_FAILURE;
    printf("%ld periods\n", number);
    return EXIT_SUCCESS;
}
