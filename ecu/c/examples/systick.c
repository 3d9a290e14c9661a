/* The ECU on a bare Cortex-M7: an interrupt of SysTick every control period, and a main loop that runs the steps.
 *
 *     python -m ziglang cc -target thumb-freestanding-eabihf -mcpu=cortex_m7+fp_armv8d16sp -std=c99 -O2 -ffreestanding \
 *         -ffp-contract=on -I. -Iboard sw_*.c board/sw_board_start.c board/sw_board_libc.c examples/systick.c \
 *         -T examples/mps2_an500.ld -Wl,-e,sw_board_start -o ecu.elf
 *     qemu-system-arm -M mps2-an500 -nographic -icount shift=1,sleep=off -semihosting -kernel ecu.elf
 *
 * The program simulates the vehicle with the frames of the generated pressures.h. The request for control begins low,
 * since the ECU ignores a request that is present from the start. The program prints each JetCommand, then a summary,
 * and ends. On a vehicle, a CAN driver replaces `vehicle` and the printing. The interrupt only counts periods. The step
 * runs in the main loop, so that it does not delay other interrupts, such as the CAN controller's interrupts.
 */
#include "pressures.h"
#include "sw_board_start.h"
#include "sw_ecu.h"

#define CLOCK_HZ INT64_C(25000000) /* clock of SysTick on this board */
#define TICK_NS (INT64_C(1000000000) / CLOCK_HZ)
#define RELOAD (SW_PERIOD_NS / TICK_NS)
#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYSTICK_CONTROL REGISTER(0xe000e010u)
#define SYSTICK_RELOAD REGISTER(0xe000e014u)
#define SYSTICK_VALUE REGISTER(0xe000e018u)

static sw_ecu ecu;
static volatile uint32_t periods; /* number of periods since the start; only the interrupt writes this variable */

/* --- The host, by semihosting: a debugger or an emulator prints. --- */

static void host(uint32_t operation, uintptr_t argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register uintptr_t r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

static void print(const char *text) { host(0x04u, (uintptr_t)text); }

static void end(int failed) { host(0x18u, failed ? 0x20023u : 0x20026u); }

static void print_number(const char *name, uint32_t number)
{
    char digits[12];
    int at = (int)sizeof digits - 1;
    digits[at] = '\0';
    digits[--at] = '\n';
    do {
        digits[--at] = (char)('0' + number % 10u);
        number /= 10u;
    } while (number != 0u);
    print(name);
    print(" ");
    print(&digits[at]);
}

static void print_frame(const char *name, const sw_frame *frame)
{
    char digits[2 * SW_FRAME_BYTES + 2];
    int at = 0;
    for (int i = 0; i < frame->length; i++) {
        digits[at++] = "0123456789abcdef"[frame->data[i] >> 4];
        digits[at++] = "0123456789abcdef"[frame->data[i] & 15];
    }
    digits[at++] = '\n';
    digits[at] = '\0';
    print(name);
    print(" ");
    print(digits);
}

/* --- Time --- */

void sw_board_tick(void) { periods++; }

/* Returns the time since the start in ns: whole periods, and the elapsed part of this period (SysTick counts down). */
static int64_t now_ns(void)
{
    uint32_t before, value;
    do {
        before = periods;
        value = SYSTICK_VALUE;
    } while (before != periods);
    return (int64_t)before * SW_PERIOD_NS + (RELOAD - 1 - (int64_t)value) * TICK_NS;
}

static void start_clock(void)
{
    SYSTICK_RELOAD = (uint32_t)(RELOAD - 1);
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = 7; /* clock source: the core; interrupt and counter on */
}

/* Waits for a new period and returns its number. Interrupts are masked between the check and the sleep. Otherwise an
 * interrupt between them would be missed. A masked interrupt stays pending and ends the sleep.
 */
static uint32_t next_period(uint32_t done)
{
    __asm__ volatile("cpsid i" ::: "memory");
    while (periods == done) __asm__ volatile("wfi\n cpsie i\n isb\n cpsid i" ::: "memory");
    __asm__ volatile("cpsie i" ::: "memory");
    return periods;
}

/* --- The vehicle --- */

#define SENT 2 /* largest number of frames in a period */

static void send(sw_frame *frame, uint32_t period, uint32_t id, const uint8_t *data, int length)
{
    frame->timestamp_ns = (int64_t)period * SW_PERIOD_NS;
    frame->id = id;
    frame->is_extended = 0;
    frame->is_fd = SW_FRAMES_FD;
    frame->length = (uint8_t)length;
    for (int i = 0; i < length; i++) frame->data[i] = data[i];
}

/* Writes the frames of period 1, 2, ..: pressures, and speed if the release needs it. Returns the number of frames. */
static int vehicle(sw_frame frames[SENT], uint32_t period)
{
    int count = 1;
    send(&frames[0], period, SW_PRESSURE_ID, pressures[period - 1u], (int)sizeof pressures[0]);
#if SW_PAST > 0
    send(&frames[1], period, SW_SPEED_ID, speeds[period - 1u], (int)sizeof speeds[0]);
    count = 2;
#endif
    return count;
}

/* --- The program --- */

typedef struct {
    uint32_t steps;
    uint32_t left_out; /* number of periods that began during the step of another period */
    uint32_t active;   /* number of steps in which the jets followed the controller */
    int64_t longest_ns;
} figures;

static void step(figures *seen, uint32_t period)
{
    sw_frame received[SENT], answers[SW_FRAMES_OUT];
    const int count = vehicle(received, period);
    const int64_t began_ns = now_ns();
    sw_ecu_step(&ecu, began_ns, received, count, answers);
    const int64_t took_ns = now_ns() - began_ns;
    if (took_ns > seen->longest_ns) seen->longest_ns = took_ns;
    if (ecu.state.fail_safe.mode == SW_CONTROL) seen->active++;
    seen->steps++;
    print_frame("command", &answers[0]);
}

void sw_board_power_on(void) {}

void sw_board_main(void)
{
    figures seen = {0, 0, 0, 0};
    (void)sw_ecu_init(&ecu); /* if this call fails, the summary shows the reason */
#if SW_SECOC
    /* Only an example: on a vehicle no debugger may read the key, and non-volatile memory counts the power cycles. */
    const sw_authentication given = {PLAYED_KEY, 1, 0, 0};
    (void)sw_ecu_authenticate(&ecu, &given);
#endif
    start_clock();
    uint32_t done = 0, period = next_period(done);
    while (period <= PRESSURE_PERIODS) {
        seen.left_out += period - done - 1u;
        step(&seen, period);
        done = period;
        period = next_period(done);
    }
    print_number("steps", seen.steps);
    print_number("left_out", seen.left_out);
    print_number("active", seen.active);
    print_number("mode", ecu.state.fail_safe.mode);
    print_number("reason", ecu.state.fail_safe.reason);
    print_number("missed", ecu.state.missed);
    print_number("overruns", ecu.state.overruns);
    print_number("longest_us", (uint32_t)(seen.longest_ns / 1000));
    end(seen.left_out != 0u);
    for (;;) __asm__ volatile("wfi");
}

/* Handles any exception except SysTick. */
void sw_board_unexpected(void)
{
    print("unexpected exception\n");
    end(1);
    for (;;) __asm__ volatile("wfi");
}
