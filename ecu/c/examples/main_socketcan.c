/* The ECU as a program for Linux, on a SocketCAN interface: an example of the calls, and a starting point for a daemon.
 *
 *     cc -std=c99 -O2 -ffp-contract=off -I. sw_*.c examples/main_socketcan.c -o ecu
 *     chrt -f 50 ./ecu can0
 *
 * If frames are authenticated (SW_SECOC), the command is `./ecu can0 bus.key freshness`: bus.key is the key file that
 * `stillwake keygen --secret` writes, and the program stores freshness values in the file freshness.
 *
 * The ECU steps at absolute deadlines on CLOCK_MONOTONIC, a fixed time after the pressures' arrival. Each frame has the
 * kernel's time of arrival. SIGTERM and SIGINT end the program; its last commands shut the jets. The exit status is 1
 * if the program cannot start, or if the interface fails.
 */
#define _GNU_SOURCE /* for mlockall, and recvmsg's control messages */

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include "sw_ecu.h"

#define ROOM 64              /* largest number of frames read per period; further frames wait in the socket */
#define GRACE 4              /* a step that would begin more than a period / GRACE late is skipped */
#define LARGEST_SLEW 32      /* a deadline moves by at most a period / LARGEST_SLEW */
#define SHUT_PERIODS 3       /* number of final commands, which shut the jets; several, as a frame may be lost */
#define SECOND INT64_C(1000000000)

static sw_ecu ecu;
static sw_frame received[ROOM];
static volatile sig_atomic_t is_stopped;

static void stop(int number)
{
    (void)number;
    is_stopped = 1;
}

static int64_t ns_of(const struct timespec *time) { return (int64_t)time->tv_sec * SECOND + (int64_t)time->tv_nsec; }

static int64_t clock_ns(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return ns_of(&now);
}

/* Sleeps until a time; returns early if a signal arrives. */
static void sleep_until(int64_t due_ns)
{
    struct timespec due;
    due.tv_sec = (time_t)(due_ns / SECOND);
    due.tv_nsec = (long)(due_ns % SECOND);
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
}

/* Opens a socket for pressures, speed, frames of other ECUs, and error frames; returns -1 and sets errno on failure. */
static int open_bus(const char *interface)
{
    const canid_t exactly = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG;
    const struct can_filter filters[] = {
        {SW_PRESSURE_ID, exactly}, {SW_SPEED_ID, exactly}, {SW_COMMAND_ID, exactly}, {SW_STATUS_ID, exactly}};
    const can_err_mask_t errors = CAN_ERR_BUSOFF | CAN_ERR_RESTARTED | CAN_ERR_CRTL;
    const int on = 1;
    struct ifreq named;
    struct sockaddr_can address;
    const int bus = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    if (bus < 0) return -1;
    memset(&named, 0, sizeof named);
    memset(&address, 0, sizeof address);
    strncpy(named.ifr_name, interface, sizeof named.ifr_name - 1);
    address.can_family = AF_CAN;
    if (setsockopt(bus, SOL_CAN_RAW, CAN_RAW_FILTER, filters, sizeof filters) == 0 &&
        setsockopt(bus, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) == 0 &&
        setsockopt(bus, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) == 0 &&
        setsockopt(bus, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on) == 0 && ioctl(bus, SIOCGIFINDEX, &named) == 0) {
        address.can_ifindex = named.ifr_ifindex;
        if (bind(bus, (const struct sockaddr *)&address, sizeof address) == 0) return bus;
    }
    const int why = errno;
    close(bus);
    errno = why;
    return -1;
}

/* Returns the kernel's arrival time, converted to CLOCK_MONOTONIC; the present time if the kernel gives no time. */
static int64_t arrival_ns(struct msghdr *message)
{
    const int64_t now_ns = clock_ns(CLOCK_MONOTONIC), date_ns = clock_ns(CLOCK_REALTIME);
    for (struct cmsghdr *part = CMSG_FIRSTHDR(message); part != NULL; part = CMSG_NXTHDR(message, part)) {
        if (part->cmsg_level == SOL_SOCKET && part->cmsg_type == SCM_TIMESTAMPNS) {
            struct timespec date;
            memcpy(&date, CMSG_DATA(part), sizeof date);
            const int64_t ago_ns = date_ns - ns_of(&date);
            return now_ns - (ago_ns > 0 ? ago_ns : 0);
        }
    }
    return now_ns;
}

/* Updates the CAN controller's health from an error frame. */
static void note_error(sw_bus_health *health, const struct canfd_frame *frame)
{
    if ((frame->can_id & CAN_ERR_BUSOFF) != 0) {
        health->is_bus_off = 1;
        if (health->bus_off < UINT32_MAX) health->bus_off++;
    }
    if ((frame->can_id & CAN_ERR_RESTARTED) != 0) health->is_bus_off = 0;
    if ((frame->can_id & CAN_ERR_CRTL) != 0) {
        health->tx_errors = frame->data[6];
        health->rx_errors = frame->data[7];
    }
}

static void to_ecu(sw_frame *frame, const struct canfd_frame *heard, int is_fd, int64_t timestamp_ns)
{
    frame->timestamp_ns = timestamp_ns;
    frame->id = heard->can_id & CAN_EFF_MASK;
    frame->is_extended = (heard->can_id & CAN_EFF_FLAG) != 0;
    frame->is_fd = (uint8_t)is_fd;
    frame->length = heard->len;
    memcpy(frame->data, heard->data, sizeof frame->data);
}

/* Reads all received frames into `received`, without waiting; returns -1 if the interface fails. */
static int receive(int bus)
{
    int count = 0;
    while (count < ROOM) {
        struct canfd_frame frame;
        union {
            struct cmsghdr aligned;
            char bytes[CMSG_SPACE(sizeof(struct timespec))];
        } control;
        struct iovec place = {&frame, sizeof frame};
        struct msghdr message;
        memset(&frame, 0, sizeof frame);
        memset(&message, 0, sizeof message);
        message.msg_iov = &place;
        message.msg_iovlen = 1;
        message.msg_control = control.bytes;
        message.msg_controllen = sizeof control.bytes;
        const ssize_t size = recvmsg(bus, &message, MSG_DONTWAIT);
        if (size < 0) return errno == EAGAIN || errno == EINTR ? count : -1;
        if ((frame.can_id & CAN_ERR_FLAG) != 0) {
            note_error(&ecu.surroundings.health, &frame);
        } else {
            to_ecu(&received[count], &frame, size == (ssize_t)CANFD_MTU, arrival_ns(&message));
            count++;
        }
    }
    return count;
}

/* Sends frames without waiting; drops frames if the queue is full. Returns -1 if the interface fails. */
static int send_frames(int bus, const sw_frame *frames, int count)
{
    for (int i = 0; i < count; i++) {
        struct canfd_frame frame;
        const size_t size = frames[i].is_fd ? CANFD_MTU : CAN_MTU;
        memset(&frame, 0, sizeof frame);
        frame.can_id = frames[i].id | (frames[i].is_extended ? CAN_EFF_FLAG : 0);
        frame.len = frames[i].length;
        frame.flags = frames[i].is_fd ? CANFD_BRS : 0;
        memcpy(frame.data, frames[i].data, sizeof frame.data);
        const ssize_t taken = send(bus, &frame, size, MSG_DONTWAIT);
        if (taken != (ssize_t)size && errno != ENOBUFS && errno != EAGAIN && errno != EINTR) return -1;
    }
    return 0;
}

/* Returns the arrival time of the pressures that the latest step used; -1 if it used no pressures. */
static int64_t used_arrival_ns(int count, uint32_t missed_before)
{
    int64_t found = -1;
    for (int i = 0; i < count && ecu.state.missed == missed_before; i++) {
        if (received[i].id == SW_PRESSURE_ID) found = received[i].timestamp_ns;
    }
    return found;
}

/* Returns the next deadline that can be met, moved slightly towards a fixed time after the pressures' arrival. */
static int64_t next_due(int64_t due_ns, int64_t arrived_ns)
{
    const int64_t late_ns = clock_ns(CLOCK_MONOTONIC) - due_ns - SW_PERIOD_NS / GRACE;
    const int64_t next_ns = due_ns + SW_PERIOD_NS * (late_ns > 0 ? (late_ns - 1) / SW_PERIOD_NS + 1 : 1);
    const int64_t most_ns = SW_PERIOD_NS / LARGEST_SLEW;
    if (arrived_ns < 0) return next_ns;
    int64_t error_ns = (arrived_ns + SW_STEP_OFFSET_NS - next_ns) % SW_PERIOD_NS;
    if (error_ns > SW_PERIOD_NS / 2) error_ns -= SW_PERIOD_NS;
    if (error_ns < -SW_PERIOD_NS / 2) error_ns += SW_PERIOD_NS;
    if (error_ns > most_ns) error_ns = most_ns;
    if (error_ns < -most_ns) error_ns = -most_ns;
    return next_ns + error_ns;
}

/* Runs one control period; returns -1 if the interface fails. */
static int period(int bus, int64_t *due_ns)
{
    sw_frame answers[SW_FRAMES_OUT];
    const uint32_t missed_before = ecu.state.missed;
    const int count = receive(bus);
    if (count < 0) return -1;
    const int sent = sw_ecu_step(&ecu, clock_ns(CLOCK_MONOTONIC), received, count, answers);
    if (send_frames(bus, answers, sent) != 0) return -1;
    *due_ns = next_due(*due_ns, used_arrival_ns(count, missed_before));
    return 0;
}

#if SW_SECOC

static const char *freshness_file;
static unsigned long long heard_speed; /* stored freshness of the speed; kept if this release does not need the speed */

/* Reads a key of exactly 32 hexadecimal digits; returns -1 on failure. */
static int read_key(const char *path, uint8_t key[SW_AES_BYTES])
{
    FILE *file = fopen(path, "r");
    int failed = file == NULL;
    for (int i = 0; i < SW_AES_BYTES && !failed; i++) {
        unsigned byte = 0;
        int length = 0;
        failed = fscanf(file, "%2x%n", &byte, &length) != 1 || length != 2;
        key[i] = (uint8_t)byte;
    }
    char more;
    failed = failed || fscanf(file, " %c", &more) == 1;
    if (file != NULL) fclose(file);
    return failed ? -1 : 0;
}

/* Replaces the file of freshness values atomically; returns -1 on failure. */
static int keep_freshness(unsigned long trip, unsigned long long pressure, unsigned long long speed)
{
    char beside[4096];
    if (snprintf(beside, sizeof beside, "%s.new", freshness_file) >= (int)sizeof beside) return -1;
    FILE *file = fopen(beside, "w");
    if (file == NULL) return -1;
    int failed = fprintf(file, "%lu %llu %llu\n", trip, pressure, speed) < 0;
    failed |= fflush(file) != 0 || fsync(fileno(file)) != 0;
    failed |= fclose(file) != 0;
    return failed || rename(beside, freshness_file) != 0 ? -1 : 0;
}

/* Counts a power cycle, then gives the ECU its key. If the freshness file is missing, the count restarts at 1, and the
 * vehicle refuses all frames. The program stores the accepted freshness values only when it ends. After a crash, frames
 * of the previous cycle can therefore be replayed until the first genuine frame arrives.
 */
static int authenticate(const char *key_file)
{
    sw_authentication given;
    unsigned long trip = 0;
    unsigned long long pressure = 0, speed = 0;
    FILE *file = fopen(freshness_file, "r");
    int failed = file == NULL ? errno != ENOENT : fscanf(file, "%lu %llu %llu", &trip, &pressure, &speed) != 3;
    if (file != NULL) fclose(file);
    failed = failed || trip >= UINT32_MAX || read_key(key_file, given.key) != 0;
    if (failed || keep_freshness(trip + 1, pressure, speed) != 0) return -1;
    given.trip = (uint32_t)(trip + 1);
    given.heard_pressure = pressure;
    given.heard_speed = speed;
    heard_speed = speed;
    failed = sw_ecu_authenticate(&ecu, &given);
    memset(given.key, 0, sizeof given.key);
    return failed ? -1 : 0;
}

static void keep_accepted(void)
{
    unsigned long long speed = heard_speed;
#if SW_PAST > 0
    speed = ecu.state.speed.receiver.verifier.freshness;
#endif
    if (keep_freshness(ecu.state.freshness.trip, ecu.state.pressures.verifier.freshness, speed) != 0) {
        fprintf(stderr, "%s: the freshness is not kept: %s\n", freshness_file, strerror(errno));
    }
}

#endif

/* Sends the last frames. They shut and disable the jets, as at power-on, but continue the counters. */
static int shut(int bus, int64_t due_ns)
{
    sw_frame answers[SW_FRAMES_OUT];
    const uint8_t command = ecu.state.command_counter, status = ecu.state.status_counter;
#if SW_SECOC
    const sw_secoc secoc = ecu.secoc;
    const sw_freshness freshness = ecu.state.freshness;
    (void)sw_ecu_init(&ecu);
    ecu.secoc = secoc;
    ecu.state.freshness = freshness;
#else
    (void)sw_ecu_init(&ecu);
#endif
    ecu.state.command_counter = command;
    ecu.state.status_counter = status;
    for (int i = 0; i < SHUT_PERIODS; i++) {
        sleep_until(due_ns);
        const int sent = sw_ecu_step(&ecu, clock_ns(CLOCK_MONOTONIC), received, 0, answers);
        if (send_frames(bus, answers, sent) != 0) return -1;
        due_ns += SW_PERIOD_NS;
    }
    return 0;
}

static void report(void)
{
    static int shown_mode = -1, shown_reason = -1;
    const int mode = ecu.state.fail_safe.mode, reason = ecu.state.fail_safe.reason;
    if (mode != shown_mode || reason != shown_reason) fprintf(stderr, "mode %d, reason %d\n", mode, reason);
    shown_mode = mode;
    shown_reason = reason;
}

int main(int argc, char **argv)
{
    struct sigaction action;
    int failed = 0;
    if (argc != (SW_SECOC ? 4 : 2)) {
        fprintf(stderr, SW_SECOC ? "usage: ecu INTERFACE KEY FRESHNESS\n" : "usage: ecu INTERFACE, e.g. ecu can0\n");
        return 1;
    }
    const int bus = open_bus(argv[1]);
    if (bus < 0) {
        fprintf(stderr, "CAN interface %s cannot be opened: %s\n", argv[1], strerror(errno));
        return 1;
    }
    memset(&action, 0, sizeof action);
    action.sa_handler = stop;
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) fprintf(stderr, "memory is not locked: %s\n", strerror(errno));
    if (sw_ecu_init(&ecu) != SW_REASON_NONE) {
        fprintf(stderr, "this build computes otherwise than the ECU's decisions need: its flags are in the head\n");
        close(bus);
        return 1;
    }
#if SW_SECOC
    freshness_file = argv[3];
    if (authenticate(argv[2]) != 0) {
        fprintf(stderr, "no key in %s, or no freshness values in %s\n", argv[2], argv[3]);
        close(bus);
        return 1;
    }
#endif
    int64_t due_ns = clock_ns(CLOCK_MONOTONIC) + SW_PERIOD_NS;
    while (!is_stopped && !failed) {
        sleep_until(due_ns);
        if (is_stopped) break;
        failed = period(bus, &due_ns) != 0;
        report();
    }
    int why = errno; /* the reason if the interface failed */
#if SW_SECOC
    keep_accepted();
#endif
    if (!failed && shut(bus, due_ns) != 0) {
        failed = 1;
        why = errno;
    }
    if (failed) fprintf(stderr, "the CAN interface fails: %s\n", strerror(why));
    close(bus);
    return failed;
}
