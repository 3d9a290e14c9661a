#include "node_host.h"

#include <string.h>

#include "sw_image.h"

/* --- Stubs of the networks and of what an image is --- */

#define PLAN 0.01f /* that the controller answers, on whatever */

static int plan_fails;

sw_image_status sw_image_open(const uint8_t *image, sw_numbers *numbers)
{
    if (image[SW_IMAGE_HEADER] == 0xffu) return SW_IMAGE_OTHER_BUILD; /* as in node_twin.py */
    memset(numbers, 0, sizeof *numbers);
    numbers->release = (const sw_release *)(const void *)&image[SW_IMAGE_HEADER];
    return SW_IMAGE_OK;
}

sw_status sw_control_step_of(const sw_program *program, sw_workspace *work, const sw_input *input, sw_output *output)
{
    (void)program;
    (void)work;
    float plan = PLAN;
    int is_zero = 1;
    for (int k = 0; k < SW_WINDOW; k++) is_zero &= input->window[k][0] == 0.0f;
    if (plan_fails == 4 || (plan_fails == 6 && !is_zero)) plan = 1.0f;
    if (plan_fails == 5) plan = -1.0f;
    if (plan_fails == 7) plan = 0.0f / 0.0f;
    memset(output, 0, sizeof *output);
    for (int k = 0; k < SW_HORIZON; k++) output->plan[k] = plan;
    return SW_OK;
}

sw_status sw_known_answer_of(const sw_program *program, sw_workspace *work, sw_input *input, sw_output *output)
{
    (void)program, (void)work, (void)input, (void)output;
    return SW_OK;
}

uint8_t sw_inexact(void) { return SW_REASON_NONE; }

/* --- Flash memory --- */

static void count(host *of) { of->writes++; }

static uint8_t *aligned(uint8_t *room) { return &room[(64u - (uintptr_t)room % 64u) % 64u]; }

uint8_t *host_memory(host *of) { return aligned(of->memory_room); }

static int erase(void *context, uint32_t sector)
{
    host *of = context;
    count(of);
    if (of->fails == 1) return 1;
    memset(host_memory(of) + sector * SW_FLASH_SECTOR, 0xff, SW_FLASH_SECTOR);
    of->looks = of->slow;
    return 0;
}

static sw_flash_state erased(void *context)
{
    host *of = context;
    if (of->looks == 0u) return SW_FLASH_DONE;
    of->looks--;
    return SW_FLASH_AT_WORK;
}

static int program(void *context, uint32_t address, const uint8_t *word)
{
    host *of = context;
    count(of);
    if (of->fails == 1) return 1;
    uint8_t *at = host_memory(of) + address;
    for (uint32_t i = 0; i < SW_FLASH_WORD; i++) {
        if (at[i] != 0xff) return 1; /* write-once */
    }
    memcpy(at, word, SW_FLASH_WORD);
    return 0;
}

static int read_flash(void *context, uint32_t address, uint8_t *data, uint32_t length)
{
    memcpy(data, host_memory(context) + address, length);
    return 0;
}

/* --- Node --- */

static int next_seed(void *context, uint8_t *bytes, uint32_t bytes_count)
{
    host *of = context;
    if (of->fails == 2 || of->fails == 3) {
        memset(bytes, 0, bytes_count);
        return of->fails == 3;
    }
    of->seeds++;
    for (uint32_t i = 0; i < bytes_count; i++) {
        const uint32_t place = bytes_count - 1u - i;
        bytes[i] = (uint8_t)(place < 8u ? of->seeds >> (8u * place) : 0u);
    }
    return 0;
}

size_t host_bytes(void) { return sizeof(host); }

void host_init(host *of, const sw_rules *rules, const uint8_t *access_key, const char *hardware, const char *serial,
               const char *software)
{
    memset(of, 0, sizeof *of);
    plan_fails = 0; /* whatever failed in the world before */
    memset(host_memory(of), 0xff, SW_FLASH_BYTES);
    of->rules = *rules;
    memcpy(of->access_key, access_key, sizeof of->access_key);
    strncpy(of->hardware, hardware, HOST_TEXT - 1);
    strncpy(of->serial, serial, HOST_TEXT - 1);
    strncpy(of->software, software, HOST_TEXT - 1);
    const sw_equipment equipment = {&of->rules, of->access_key, of->hardware, of->serial, of->software, next_seed, of,
                                    SW_FRAMES_FD ? aligned(of->copy_room) : NULL, HOST_COPY};
    const sw_flash flash = {of, host_memory(of), erase, erased, program, read_flash};
    of->room = SW_ISOTP_BURST;
    of->equipment = equipment;
    of->flash = flash;
}

#if SW_SECOC
/* The bus key, as in variants.py; freshness goes on behind a reset. */
static void authenticate(host *of, const sw_ecu_state *before)
{
    sw_ecu *ecu = &of->node.ecu;
    sw_authentication given = {.trip = 1};
    for (uint8_t i = 0; i < sizeof given.key; i++) given.key[i] = (uint8_t)(i + 1u);
    (void)sw_ecu_authenticate(ecu, &given);
    if (of->has_begun) {
        ecu->state.freshness = before->freshness;
        ecu->state.pressures.verifier = before->pressures.verifier;
    }
    of->has_begun = 1;
}
#endif

void host_power_on(host *of)
{
#if SW_SECOC
    const sw_ecu_state before = of->node.ecu.state;
#endif
    memset(&of->node, 0xa5, sizeof of->node); /* memory at power-on holds anything */
    sw_node_init(&of->node, &of->equipment, &of->flash, of->message);
#if SW_SECOC
    authenticate(of, &before);
#endif
}

int host_provision(host *of, const uint8_t *keys, uint32_t key_bytes, const uint8_t *image, uint32_t length,
                   const uint8_t *sha256)
{
    sw_store *store = &of->node.store;
    host_power_on(of);
    sw_store_result result = sw_store_take_keys(store, keys, key_bytes);
    if (length == 0u || result != SW_STORE_DONE) return (int)result;
    result = sw_store_announce(store, length, sha256);
    while (result == SW_STORE_MORE) result = sw_store_go_on(store);
    if (result == SW_STORE_DONE) result = sw_store_append(store, image, length);
    while (result == SW_STORE_MORE) result = sw_store_go_on(store);
    if (result == SW_STORE_DONE) result = sw_store_finish(store);
    while (result == SW_STORE_MORE) result = sw_store_go_on(store);
    if (result == SW_STORE_DONE) result = sw_store_activate(store);
    host_power_on(of);
    return (int)(result == SW_STORE_DONE ? sw_store_confirm(store) : result);
}

int host_control(host *of, int64_t now_ns, const sw_frame *frames, int frame_count, sw_frame *sent)
{
    return sw_node_control(&of->node, now_ns, frames, frame_count, sent);
}

int host_service(host *of, int64_t now_ns, const sw_frame *frames, int frame_count, sw_frame *sent)
{
    const uint32_t before = of->writes;
    const int found = sw_node_service(&of->node, now_ns, frames, frame_count, of->room, sent);
    if (of->writes - before > of->worst) of->worst = of->writes - before;
    return found;
}

uint32_t host_fact(const host *of, int which)
{
    const sw_node *node = &of->node;
    const uint32_t facts[] = {(uint32_t)sw_node_is_busy(node), (uint32_t)sw_node_wants_reset(node),
                              (uint32_t)sw_node_needs_reset(node), node->services.uds.session, node->services.uds.access.unlocked,
                              node->store.reason, node->store.running, of->worst,
                              (uint32_t)sw_node_waits(node), node->services.request.drives_jets, of->writes};
    return facts[which];
}

void host_fail(host *of, int what)
{
    of->fails = what;
    plan_fails = what;
}

void host_set(host *of, uint32_t slow, int room)
{
    of->slow = slow;
    of->room = room;
}

/* Counts of branches that were taken, to their files. */
#if defined(HOST_COVERAGE)
extern void __gcov_dump(void);
void host_dump(void) { __gcov_dump(); }
#else
void host_dump(void) {}
#endif
