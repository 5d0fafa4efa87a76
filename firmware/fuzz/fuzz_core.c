/* Fuzzing of the core: for any host bytes and sensor values its invariants hold.
 *
 * The input is a script: a byte for what happens, taken modulo 5, and its operands.
 *
 *   0 n bytes...        as they are, from the line
 *   1 type n bytes...   the same as a sound frame of that type
 *   2 n                 n control ticks
 *   3 floats...         sensor values from now on: d and q of each mode
 *   4                   the line takes what is to be sent
 *
 * libFuzzer writes such scripts; with HD_FUZZ_REPLAY a plain program plays files of them instead.
 */
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core.h"

#define TICK_US 500

enum { RAW, FRAME, RUN, SENSE, LISTEN, OPERATIONS };

static const float V_LIMIT_V = 150.0f;
static const float W_LIMIT_UM = 4.0f;
static const float DRIVE_HZ = 29205.0f;

typedef struct {
    hd_core_t core;
    uint32_t now_us;
    hd_phasor_t measured_um[HD_MODES];
    int references; /* received since the core was last not armed */
} world_t;

typedef struct {
    const uint8_t *bytes;
    size_t n;
} script_t;

static void expect(bool condition, const char *what)
{
    if (!condition) {
        fprintf(stderr, "NOT TRUE: %s\n", what);
        abort();
    }
}

static script_t take(script_t *script, size_t n)
{
    script_t taken = {script->bytes, n < script->n ? n : script->n};
    script->bytes += taken.n;
    script->n -= taken.n;
    return taken;
}

static uint8_t take_byte(script_t *script)
{
    script_t one = take(script, 1);
    return one.n == 1 ? one.bytes[0] : 0;
}

static void start(world_t *world)
{
    hd_config_t config = {
        .boot_id = 1, .control_hz = 1e6f / TICK_US, .drive_hz = DRIVE_HZ, .v_limit_v = V_LIMIT_V,
        .gains = {.law = HD_LAW_PI_FF}, .output_delay_frac = 0.2f,
    };
    for (int k = 0; k < HD_MODES; k++) {
        config.w_limit_um[k] = W_LIMIT_UM;
        config.model[k] = (hd_mode_model_t){183.5f, k % 2 == 0 ? -62.8f : 62.8f, 5.2f, {1.0f, 0.0f}};
    }
    memset(world, 0, sizeof *world);
    world->now_us = 0xFFFFFFFFu - 20000; /* the clock wraps in the first moments */
    expect(hd_init(&world->core, &config, world->now_us), "a sensible configuration is taken");
}

static void expect_bounded_output(const hd_core_t *core, const hd_phasor_t voltage_v[HD_MODES])
{
    bool tool = core->state == HD_STATE_TOOL;
    bool driven = tool || core->state == HD_STATE_LIVE || core->ramp > 0;
    float limit_v = (tool ? HD_RAW_LIMIT_FRAC : 1.0f) * V_LIMIT_V * 1.000001f;
    for (int k = 0; k < HD_MODES; k++) {
        expect(hd_finite(voltage_v[k]), "every voltage is finite");
        expect(hd_magnitude(voltage_v[k]) <= limit_v, "no voltage is above its limit");
        expect(driven || hd_magnitude(voltage_v[k]) == 0.0f, "who is not trusted drives nothing");
        expect(hd_magnitude(core->asked_um[k]) <= W_LIMIT_UM * 1.000002f, "no reference is above its limit");
    }
}

static void expect_sane_core(const hd_core_t *core)
{
    const hd_tool_t *tool = &core->tool;
    expect(core->state <= HD_STATE_TOOL, "the state exists");
    expect(core->fault != HD_FAULT_CONFIG && core->fault != HD_FAULT_MEMORY, "no script damages what the board is set to");
    expect((core->state == HD_STATE_FAULT) == (core->fault != HD_FAULT_NONE), "a fault is a state");
    expect((core->state == HD_STATE_TOOL) == (tool->kind != HD_TOOL_NONE), "a tool is a state");
    const hd_follower_t *follower = &core->follower;
    expect(core->state == HD_STATE_TOOL || core->drive_hz == follower->drive_hz, "after a tool the drive is the plate's");
    expect(fabsf(follower->base_hz - DRIVE_HZ) <= HD_DRIVE_MOVE_MAX_HZ, "the drive is set near the first one");
    expect(fabsf(follower->drive_hz - follower->base_hz) <= follower->reach_hz, "the drive follows within its reach");
    expect(core->state != HD_STATE_TOOL || fabsf(core->drive_hz - DRIVE_HZ) <= HD_SWEEP_OFFSET_MAX_HZ + HD_DRIVE_MOVE_MAX_HZ + HD_FOLLOW_MAX_HZ, "a sweep stays near the drive");
    expect(core->receiver.n <= sizeof core->receiver.bytes, "the receiver keeps within its buffer");
    expect(core->timeline.count <= HD_POLYLINES && core->timeline.first < HD_POLYLINES, "the timeline's ring is sane");
    expect(core->telemetry.count <= HD_TELEMETRY_SAMPLES && core->telemetry.first < HD_TELEMETRY_SAMPLES,
           "the telemetry's ring is sane");
    expect(tool->count <= HD_SWEEP_RING && tool->first < HD_SWEEP_RING, "the ring of sweep points is sane");
    expect(core->ramp <= core->ramp_ticks, "the ramp ends");
}

static void run(world_t *world, uint8_t ticks)
{
    for (int i = 0; i < ticks; i++) {
        bool was_live = world->core.state == HD_STATE_LIVE;
        hd_phasor_t voltage_v[HD_MODES];
        world->now_us += TICK_US;
        hd_tick(&world->core, world->now_us, world->measured_um, voltage_v);
        bool is_live = world->core.state == HD_STATE_LIVE;
        expect(!is_live || was_live || world->references >= HD_REARM_FRAMES, "three references come before the drive");
        world->references = is_live && !was_live ? 0 : world->references;
        expect_bounded_output(&world->core, voltage_v);
        expect_sane_core(&world->core);
    }
}

static void receive_frame(world_t *world, uint8_t type, script_t payload)
{
    uint8_t line[HD_LINE_SIZE(1 + 255 + 2)];
    size_t n = hd_frame_encode(type, payload.bytes, payload.n, line);
    hd_receive(&world->core, line, n, world->now_us);
    world->references += type == HD_MSG_REFERENCE;
}

/* `n` floats from `bytes` on, `stride` bytes apart. */
static void expect_finite(const uint8_t *bytes, size_t n, size_t stride)
{
    for (size_t i = 0; i < n; i++) {
        float value;
        memcpy(&value, bytes + i * stride, sizeof value);
        expect(fabsf(value) <= FLT_MAX, "the host can read every number that is sent");
    }
}

#define EXPECT_FINITE_FROM(type, field) \
    expect_finite(payload + offsetof(type, field), (sizeof(type) - offsetof(type, field)) / sizeof(float), sizeof(float))

static void expect_readable(const uint8_t *frame)
{
    const uint8_t *payload = frame + 1;
    switch (frame[0]) {
    case HD_MSG_STATUS:
        expect_finite(payload + offsetof(hd_wire_status_t, mode), 4 * HD_MODES + 1, sizeof(float));
        break;
    case HD_MSG_CONTROLLER:
        expect_finite(payload + offsetof(hd_wire_controller_t, bandwidth_1_s), 2, sizeof(float));
        EXPECT_FINITE_FROM(hd_wire_controller_t, model);
        break;
    case HD_MSG_SWEEP_POINT:
        EXPECT_FINITE_FROM(hd_wire_sweep_point_t, frequency_hz);
        break;
    case HD_MSG_TELEMETRY:
        EXPECT_FINITE_FROM(hd_wire_telemetry_t, mode);
        break;
    case HD_MSG_LOG:
        expect_finite(payload + offsetof(hd_wire_log_t, entry) + offsetof(hd_wire_log_entry_t, value), HD_LOG_ENTRIES,
                      sizeof(hd_wire_log_entry_t));
        break;
    default:
        break;
    }
}

static void receive_from(world_t *world)
{
    uint8_t out[3 * HD_TRANSMIT_MIN];
    hd_receiver_t host = {0};
    size_t n = hd_transmit(&world->core, world->now_us, out, sizeof out), frame_n;
    expect(n <= sizeof out, "what is sent fits");
    for (size_t i = 0; i < n; i++) {
        hd_rx_t event = hd_receiver_push(&host, out[i], &frame_n);
        expect(event != HD_RX_DAMAGED, "what is sent is made of sound frames");
        if (event == HD_RX_FRAME) {
            expect_readable(host.bytes);
        }
    }
    expect(host.n == 0, "what is sent ends with a whole frame");
}

static void sense(world_t *world, script_t *script)
{
    script_t floats = take(script, sizeof world->measured_um);
    if (floats.n == sizeof world->measured_um) {
        memcpy(world->measured_um, floats.bytes, sizeof world->measured_um);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    script_t script = {data, size};
    world_t world;
    start(&world);
    while (script.n > 0) {
        uint8_t operation = take_byte(&script) % OPERATIONS, type;
        script_t bytes;
        switch (operation) {
        case RAW:
            bytes = take(&script, take_byte(&script));
            hd_receive(&world.core, bytes.bytes, bytes.n, world.now_us);
            world.references += (int)(bytes.n / 8); /* as many as could be hidden in them */
            break;
        case FRAME:
            type = take_byte(&script);
            receive_frame(&world, type, take(&script, take_byte(&script)));
            break;
        case RUN:
            run(&world, take_byte(&script));
            break;
        case SENSE:
            sense(&world, &script);
            break;
        default:
            receive_from(&world);
        }
        expect_sane_core(&world.core);
    }
    return 0;
}

#ifdef HD_FUZZ_REPLAY
int main(int files, char **names)
{
    static uint8_t script[1 << 20];
    for (int i = 1; i < files; i++) {
        FILE *file = fopen(names[i], "rb");
        expect(file != NULL, "the script can be read");
        size_t n = fread(script, 1, sizeof script, file);
        fclose(file);
        LLVMFuzzerTestOneInput(script, n);
    }
    printf("%d scripts played, %d modes\n", files - 1, HD_MODES);
    return 0;
}
#endif
