/* Hostile requests to a node, as a program of its own, so that sanitisers watch it.
 *
 *     node_fuzz FILE SEED REQUESTS
 *
 * The file has parts, each a length (4 bytes, little-endian) and bytes: the rules, the shared key, the key list and the
 * image from production; then how many images may run (4 bytes), each by its SHA-256; then the corpus of requests. Prints
 * what was counted, a name and a number a line; a number of a violation must be 0.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "node_host.h"

#define MS INT64_C(1000000)
#define MOST_PIECES 200
#define MOST_PARTS 200000
#define MAX_GOOD 64

typedef struct {
    const uint8_t *bytes;
    uint32_t length;
} part;

static part parts[MOST_PARTS];
static uint32_t part_count;
static uint8_t good[MAX_GOOD][32];
static uint32_t good_count;
static uint64_t rng;
static int calm; /* a stretch in which testers mean well */
static int64_t now_ns = 1000000000;
static host *ecu;
static uint8_t last_seed[16];
static uint32_t offered; /* levels, a bit each, for which the right key was sent since none was unlocked */
static uint8_t tool_answer[SW_XCP_MAX_CTO]; /* latest packet for the calibration tool */
static int tool_has_key; /* the tool sends the end of the right key, or has sent it and is unlocked */
static uint32_t least_version, least_keys;
static struct {
    uint32_t requests, positive, negative, pending, silent, resets, boots, trials, confirmed;
    uint32_t tool_unlocked, tool_packets;
    uint32_t stuck, unlocked_without_key, activated_unsigned, releases_lost, went_back, wrong_answers;
} counted;

static uint32_t drawn(uint32_t below)
{
    rng ^= rng << 13;
    rng ^= rng >> 7;
    rng ^= rng << 17;
    return (uint32_t)((rng >> 16) % below);
}

/* What must hold after every call, by what stands in the store. */
static void look(void)
{
    const sw_store *store = &ecu->node.store;
    if (ecu->node.services.uds.access.unlocked != 0u && (offered & 1u << ecu->node.services.uds.access.unlocked) == 0u) counted.unlocked_without_key++;
    if (ecu->node.services.uds.access.unlocked == 0u) offered = 0;
    if (ecu->node.services.uds.session == SW_SESSION_DEFAULT && ecu->node.services.uds.access.unlocked != 0u) counted.unlocked_without_key++;
    counted.unlocked_without_key += ecu->node.xcp.access.is_unlocked && !tool_has_key;
    tool_has_key &= ecu->node.xcp.access.is_unlocked;
    for (uint32_t slot = 0; slot < 2u; slot++) {
        const sw_slot_state *standing = &store->state.slots[slot];
        uint32_t found = 0;
        if (standing->phase < SW_PHASE_CHECKED || standing->phase > SW_PHASE_CONFIRMED) continue;
        for (uint32_t i = 0; i < good_count; i++) found |= memcmp(good[i], standing->sha256, 32) == 0;
        counted.activated_unsigned += !found;
    }
    counted.releases_lost += store->state.active == SW_NO_SLOT;
    counted.went_back += store->state.least_security_version < least_version || sw_key_list_version(store->keys) < least_keys;
    least_version = store->state.least_security_version;
    least_keys = sw_key_list_version(store->keys);
}

static void power_on(void)
{
    host_power_on(ecu);
    offered = 0;
    counted.boots++;
    counted.trials += ecu->node.store.reason == SW_BOOT_TRIAL;
    if (ecu->node.ecu.numbers.release == NULL) counted.releases_lost++;
    look();
}

/* Answers are read out of the frames; only their beginnings matter. */
static void hear(const sw_frame *frames, int count, uint8_t service, int *answered)
{
    for (int i = 0; i < count; i++) {
        const uint8_t *data = frames[i].data;
        if (frames[i].id != SW_RESPONSE_ID || data[0] >> 4 > 1u) continue;
        const uint8_t *answer = data[0] >> 4 == 1u || data[0] == 0u ? &data[2] : &data[1];
        if (answer[0] == 0x7fu && answer[2] == 0x78u) {
            counted.pending++;
            continue;
        }
        if (answer[0] == 0x67u && (answer[1] & 1u) != 0u) memcpy(last_seed, &answer[2], 16);
        counted.positive += answer[0] != 0x7fu;
        counted.negative += answer[0] == 0x7fu;
        counted.wrong_answers += answer[0] == 0x7fu ? answer[1] != service : answer[0] != (uint8_t)(service + 0x40u);
        *answered = 1;
    }
}

static int serve(const sw_frame *frames, int count, uint8_t service)
{
    sw_frame sent[SW_ISOTP_BURST];
    int answered = 0;
    now_ns += 1 + drawn(calm ? 2000000u : 15000000u);
    hear(sent, host_service(ecu, now_ns, frames, count, sent), service, &answered);
    look();
    if (sw_node_wants_reset(&ecu->node)) {
        counted.resets++;
        power_on();
    }
    return answered;
}

static sw_frame frame_of(const uint8_t *bytes, uint32_t length)
{
    static const uint8_t lengths[] = {8, 12, 16, 20, 24, 32, 48, 64};
    sw_frame frame = {0};
    uint32_t i = 0;
    while (lengths[i] < length) i++;
    frame.id = SW_REQUEST_ID;
    frame.is_fd = 1;
    frame.length = lengths[i];
    memcpy(frame.data, bytes, length);
    return frame;
}

/* The whole request in frames, then pieces of work until the node is idle. */
static void ask(const uint8_t *request, uint32_t length)
{
    static sw_frame frames[80];
    uint8_t bytes[64];
    int count = 0;
    int answered = 0;
    counted.requests++;
    if (length <= 62u) {
        bytes[0] = (uint8_t)(length < 8u ? length : 0u);
        bytes[1] = (uint8_t)length;
        memcpy(&bytes[length < 8u ? 1 : 2], request, length);
        frames[count++] = frame_of(bytes, length + (length < 8u ? 1u : 2u));
    } else {
        bytes[0] = (uint8_t)(0x10u | length >> 8);
        bytes[1] = (uint8_t)length;
        memcpy(&bytes[2], request, 62);
        frames[count++] = frame_of(bytes, 64);
        for (uint32_t at = 62, number = 1; at < length; at += 63u, number++) {
            const uint32_t piece = length - at < 63u ? length - at : 63u;
            bytes[0] = (uint8_t)(0x20u | (number & 15u));
            memcpy(&bytes[1], &request[at], piece);
            frames[count++] = frame_of(bytes, piece + 1u);
        }
    }
    answered = serve(frames, count, request[0]);
    for (int i = 0; sw_node_is_busy(&ecu->node); i++) {
        if (i == MOST_PIECES) {
            counted.stuck++;
            power_on();
            return;
        }
        answered |= serve(NULL, 0, request[0]);
        /* Have a long answer go on, and end. */
        const uint8_t flow[3] = {0x30, 0, 0};
        if (ecu->node.isotp.queue.under_way > 0u) {
            frames[0] = frame_of(flow, 3);
            answered |= serve(frames, 1, request[0]);
        }
    }
    counted.silent += !answered;
}

static void right_answer(uint8_t level, const uint8_t *seed, uint32_t length, uint8_t right[16])
{
    static const char label[] = "stillwake access";
    uint8_t text[17], own[16];
    memcpy(text, label, 16);
    text[16] = level;
    sw_aes_cmac(ecu->access_key, text, 17, own);
    sw_aes_cmac(own, seed, length, right);
}

static void answer_seed(uint8_t *request, uint32_t length)
{
    uint8_t right[16];
    const uint8_t level = (uint8_t)((request[1] & 0x7fu) - 1u);
    right_answer(level, last_seed, sizeof last_seed, right);
    if (length != 18u) return;
    if (calm || drawn(10) < 8u) memcpy(&request[2], right, 16);
    if (level <= SW_LEVEL_CALIBRATION && memcmp(&request[2], right, 16) == 0) offered |= 1u << level;
}

static uint32_t damaged(uint8_t *request, uint32_t length)
{
    for (uint32_t k = drawn(3); k < 3u; k++) {
        const uint32_t at = drawn(length);
        switch (drawn(6)) {
        case 0: request[at] ^= (uint8_t)(1u << drawn(8)); break;
        case 1: request[drawn(length < 4u ? length : 4u)] = (uint8_t)drawn(256); break;
        case 2: length = 1u + drawn(length); break;
        case 3: if (length < 4000u) { memset(&request[length], (int)drawn(256), 7); length += 1u + drawn(7); } break;
        case 4: request[at] = (uint8_t)drawn(256); break;
        default: if (length > 1u) request[1] ^= 0x80u; break;
        }
    }
    return length;
}

/* --- A calibration tool --- */

#define TELL(...) tell((const uint8_t[SW_XCP_MAX_CTO]){__VA_ARGS__})

/* A packet, now and then altered or shorter, and what comes back. */
static void tell(const uint8_t packet[SW_XCP_MAX_CTO])
{
    sw_frame sent[SW_ISOTP_BURST];
    sw_frame frame = frame_of(packet, SW_XCP_MAX_CTO);
    frame.id = SW_XCP_COMMAND_ID;
    if (drawn(60) == 0u) frame.data[drawn(SW_XCP_MAX_CTO)] = (uint8_t)drawn(256);
    if (drawn(60) == 0u) frame.length = (uint8_t)drawn(SW_XCP_MAX_CTO + 1u);
    now_ns += 1 + drawn(2000000u);
    const int count = host_service(ecu, now_ns, &frame, 1, sent);
    for (int i = 0; i < count; i++) {
        if (sent[i].id != SW_XCP_RESPONSE_ID) continue;
        memcpy(tool_answer, sent[i].data, sizeof tool_answer);
        counted.tool_packets++;
    }
    look();
    if (sw_node_wants_reset(&ecu->node)) power_on();
}

static void unlock_as_tool(void)
{
    uint8_t seed[SW_XCP_SEED_LENGTH], right[16], packet[SW_XCP_MAX_CTO];
    TELL(SW_XCP_CONNECT);
    for (uint32_t at = 0; at < sizeof seed; at += 6u) {
        TELL(SW_XCP_GET_SEED, at > 0u, SW_XCP_CAL_PAG);
        memcpy(&seed[at], &tool_answer[2], 6);
    }
    right_answer(SW_LEVEL_CALIBRATION, seed, sizeof seed, right);
    const int is_right = drawn(5) > 0u;
    right[3] ^= !is_right;
    for (uint32_t at = 0; at < 16u; at += 6u) {
        packet[0] = SW_XCP_UNLOCK;
        packet[1] = (uint8_t)(16u - at);
        memcpy(&packet[2], &right[at], at < 12u ? 6 : 4);
        tool_has_key |= at == 12u && is_right;
        tell(packet);
    }
    counted.tool_unlocked += ecu->node.xcp.access.is_unlocked;
}

/* A list of any shape, which runs. */
static void measure_as_tool(void)
{
    const uint32_t odts = 1u + drawn(SW_XCP_ODTS);
    TELL(SW_XCP_CONNECT);
    TELL(SW_XCP_FREE_DAQ);
    TELL(SW_XCP_ALLOC_DAQ, 0, 1);
    TELL(SW_XCP_ALLOC_ODT, 0, 0, 0, (uint8_t)odts);
    for (uint32_t odt = 0; odt < odts; odt++) TELL(SW_XCP_ALLOC_ODT_ENTRY, 0, 0, 0, (uint8_t)odt, (uint8_t)(1u + drawn(3)));
    for (uint32_t odt = 0; odt < odts; odt++) {
        TELL(SW_XCP_SET_DAQ_PTR, 0, 0, 0, (uint8_t)odt, (uint8_t)drawn(3));
        const uint32_t at = SW_XCP_MEASURED + drawn(sizeof(sw_measured) + 2u) - 1u;
        for (uint32_t k = drawn(3); k > 0u; k--) {
            TELL(SW_XCP_WRITE_DAQ, 0xff, (uint8_t)drawn(8), 0, (uint8_t)at, (uint8_t)(at >> 8), (uint8_t)(at >> 16), (uint8_t)(at >> 24));
        }
    }
    TELL(SW_XCP_START_STOP_DAQ_LIST, (uint8_t)(1u + drawn(2)));
    TELL(SW_XCP_START_STOP_SYNCH, 1);
}

/* Commands of any kind, by addresses in the calibration and in the measured values, and beside them. */
static void any_as_tool(void)
{
    static const uint8_t commands[][3] = SW_XCP_COMMANDS;
    for (uint32_t k = drawn(20); k > 0u; k--) {
        uint8_t packet[SW_XCP_MAX_CTO];
        const uint32_t at = (drawn(2) > 0u ? SW_XCP_ADDRESS : SW_XCP_MEASURED) + drawn(sizeof(sw_measured) + 2u) - 1u;
        packet[0] = drawn(20) > 0u ? commands[drawn(sizeof commands / 3u)][0] : (uint8_t)drawn(256);
        for (uint32_t i = 1; i < SW_XCP_MAX_CTO; i++) packet[i] = (uint8_t)(drawn(3) > 0u ? drawn(9) : drawn(256));
        if (drawn(2) > 0u) memcpy(&packet[4], &at, 4);
        tell(packet);
    }
}

static void tool(void)
{
    if (drawn(2) > 0u) unlock_as_tool();
    if (drawn(3) == 0u) measure_as_tool();
    any_as_tool();
}

static void garbage(void)
{
    sw_frame frames[130];
    const int count = (int)drawn(130);
    memset(frames, 0, sizeof frames);
    for (int i = 0; i < count; i++) {
        frames[i].id = drawn(8) > 0u ? SW_REQUEST_ID : drawn(8) > 0u ? SW_XCP_COMMAND_ID : drawn(2048);
        frames[i].is_extended = (uint8_t)(drawn(30) == 0u);
        frames[i].length = (uint8_t)(drawn(20) > 0u ? drawn(65) : drawn(256));
        for (int k = 0; k < SW_FRAME_BYTES; k++) frames[i].data[k] = (uint8_t)drawn(256);
        if (drawn(2) > 0u) frames[i].data[0] &= 0x3fu;
    }
    sw_frame sent[SW_ISOTP_BURST];
    now_ns += 1;
    (void)host_service(ecu, drawn(50) > 0u ? now_ns : (int64_t)(rng >> drawn(64)), frames, count, sent);
    if (sw_node_wants_reset(&ecu->node)) power_on();
    /* Whatever is left of it ends by the timers. */
    now_ns += 1100 * MS;
    for (int i = 0; i < MOST_PIECES && sw_node_is_busy(&ecu->node); i++) {
        (void)host_service(ecu, now_ns, NULL, 0, sent);
        if (sw_node_wants_reset(&ecu->node)) power_on();
    }
    now_ns += 1100 * MS;
    (void)host_service(ecu, now_ns, NULL, 0, sent);
    look();
}

static void load(const char *name)
{
    FILE *file = fopen(name, "rb");
    if (file == NULL) exit(2);
    fseek(file, 0, SEEK_END);
    const long size = ftell(file);
    uint8_t *all = malloc((size_t)size);
    rewind(file);
    if (fread(all, 1, (size_t)size, file) != (size_t)size) exit(2);
    fclose(file);
    for (uint32_t at = 0; at + 4u <= (uint32_t)size && part_count < MOST_PARTS;) {
        memcpy(&parts[part_count].length, &all[at], 4);
        parts[part_count].bytes = &all[at + 4u];
        at += 4u + parts[part_count++].length;
    }
}

int main(int argc, char **argv)
{
    sw_frame sent[SW_FRAMES_OUT];
    static uint8_t request[SW_ISOTP_MOST + 16];
    uint8_t digest[32];
    if (argc != 4) return 2;
    load(argv[1]);
    rng = 0x9e3779b97f4a7c15u * (strtoull(argv[2], NULL, 10) + 1u);
    const uint32_t requests = (uint32_t)strtoul(argv[3], NULL, 10);
    sw_rules rules;
    memcpy(&rules, parts[0].bytes, sizeof rules);
    ecu = malloc(sizeof *ecu);
    host_init(ecu, &rules, parts[1].bytes, "bench", "0815", "bench");
    sw_sha256_of(parts[3].bytes, parts[3].length, digest);
    if (host_provision(ecu, parts[2].bytes, parts[2].length, parts[3].bytes, parts[3].length, digest) != 0) return 3;
    good_count = parts[4].length / 32u;
    memcpy(good, parts[4].bytes, parts[4].length);
    power_on();
    uint32_t at = 5;
    while (counted.requests < requests) {
        if (drawn(80) == 0u) calm = !calm;
        if (!calm && drawn(40) == 0u) at = 5u + drawn(part_count - 5u);
        const uint32_t picked = calm || drawn(8) > 0u ? at++ : 5u + drawn(part_count - 5u);
        if (at >= part_count) at = 5;
        uint32_t length = parts[picked].length;
        memcpy(request, parts[picked].bytes, length);
        if (!calm && drawn(5) == 0u) length = damaged(request, length);
        if (request[0] == SW_SERVICE_SECURITY && length >= 2u) answer_seed(request, length);
        ask(request, length);
        if (drawn(calm ? 2000 : 20) == 0u) now_ns += (int64_t)drawn(12000) * MS;
        if (!calm && drawn(50) == 0u) garbage();
        if (drawn(8) == 0u) tool();
        if (drawn(500) == 0u) power_on();
        if (drawn(4) == 0u) (void)host_control(ecu, now_ns, NULL, 0, sent);
        for (uint32_t slot = 0; slot < 2u; slot++) {
            counted.confirmed += ecu->node.store.state.slots[slot].phase == SW_PHASE_CONFIRMED && slot != 0u;
        }
    }
    printf("requests %u\npositive %u\nnegative %u\npending %u\nsilent %u\nresets %u\nboots %u\ntrials %u\nconfirmed %u\n",
           counted.requests, counted.positive, counted.negative, counted.pending, counted.silent, counted.resets,
           counted.boots, counted.trials, counted.confirmed);
    printf("tool_unlocked %u\ntool_packets %u\n", counted.tool_unlocked, counted.tool_packets);
    printf("stuck %u\nunlocked_without_key %u\nactivated_unsigned %u\nreleases_lost %u\nwent_back %u\nwrong_answers %u\n",
           counted.stuck, counted.unlocked_without_key, counted.activated_unsigned, counted.releases_lost,
           counted.went_back, counted.wrong_answers);
    free(ecu);
    return 0;
}
