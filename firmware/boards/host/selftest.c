/* The firmware against a simulated plate, in C alone: what `make check` runs under the sanitizers. */
#include <complex.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "codec.h"
#include "core.h"
#include "lockstep.h"
#include "plate.h"

#define ROWS 400
#define TICK_US 500

static const double LIMIT_V = 150.0;
static const double LIMIT_UM = 4.0;

typedef struct {
    hd_board_t *board;
    uint16_t seq;
    double complex reference_um[ROWS * HD_MODES], measured_um[ROWS * HD_MODES];
    double complex plate_um[ROWS * HD_MODES], voltage_v[ROWS * HD_MODES];
    uint8_t flags[ROWS];
} bench_t;

static void expect(bool condition, const char *what)
{
    if (!condition) {
        printf("selftest, %d modes: NOT TRUE: %s\n", HD_MODES, what);
        exit(1);
    }
}

static void start(bench_t *bench, uint64_t t_start_us, enum hd_law law)
{
    double decay[HD_MODES], detuning[HD_MODES], gain[HD_MODES * HD_MODES] = {0}, sensor[HD_MODES * HD_MODES] = {0};
    double nominal_gain[HD_MODES], limit_um[HD_MODES], loop_phase[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        decay[k] = 183.5;
        detuning[k] = 62.8 * (k % 2 == 0 ? -1.0 : 1.0);
        nominal_gain[k] = gain[k * HD_MODES + k] = 5.17;
        sensor[k * HD_MODES + k] = 1.0;
        limit_um[k] = LIMIT_UM;
        loop_phase[k] = 0.3 * (k - 1);
    }
    hd_board_setup_t setup = {
        .plate_modes = HD_MODES, .decay_1_s = decay, .detuning_rad_s = detuning, .gain_um_per_v_s = gain,
        .sensor = sensor, .loop_phase_rad = loop_phase, .noise_um = 0.0006, .amplifier_limit_v = LIMIT_V, .seed = 7,
        .t_start_us = t_start_us, .boot_id = 1, .control_hz = 1e6 / TICK_US, .drive_hz = 29205.0, .v_limit_v = LIMIT_V,
        .w_limit_um = limit_um, .nominal_decay_1_s = decay, .nominal_detuning_rad_s = detuning,
        .nominal_gain_um_per_v_s = nominal_gain, .nominal_loop_phase_rad = loop_phase, .law = (int32_t)law,
    };
    memset(bench, 0, sizeof *bench);
    bench->board = hd_board_new(&setup);
    expect(bench->board != NULL, "a board starts with a sensible setup");
}

/* With a finger on the plate, of this modal shape, if its decay is not 0. */
static void run_touched(bench_t *bench, size_t ticks, size_t row, const double phi[HD_MODES], double decay_1_s)
{
    double shapes[ROWS * HD_MODES], decays_1_s[ROWS];
    for (size_t i = 0; i < ticks; i++) {
        memcpy(shapes + i * HD_MODES, phi, HD_MODES * sizeof *phi);
        decays_1_s[i] = decay_1_s;
    }
    hd_board_trace_t trace = {
        (double *)bench->reference_um, (double *)bench->measured_um, (double *)bench->plate_um,
        (double *)bench->voltage_v, bench->flags,
    };
    hd_board_run(bench->board, ticks, 1, shapes, decays_1_s, NULL, &trace, row, 0);
}

static void run(bench_t *bench, size_t ticks, size_t row)
{
    const double nowhere[HD_MODES] = {0.0};
    run_touched(bench, ticks, row, nowhere, 0.0);
}

static void send(bench_t *bench, uint8_t type, const void *payload, size_t n)
{
    uint8_t line[HD_LINE_SIZE(HD_FRAME_MAX)];
    size_t length = hd_frame_encode(type, payload, n, line);
    hd_board_receive(bench->board, line, length, hd_board_t_us(bench->board));
}

static void send_reference(bench_t *bench, float amplitude_um)
{
    struct HD_PACKED {
        hd_wire_reference_t head;
        hd_wire_knot_t knot;
    } message = {{bench->seq++, (uint32_t)hd_board_t_us(bench->board), 1, HD_MODES}, {0}};
    for (int k = 0; k < HD_MODES; k++) {
        message.knot.modal[k].d_um = amplitude_um;
    }
    send(bench, HD_MSG_REFERENCE, &message, sizeof message);
}

/* A host that sends the same reference every 10 ms, three at once at first. */
static void drive_touched(bench_t *bench, float amplitude_um, size_t from, size_t to, const double phi[HD_MODES],
                          double decay_1_s)
{
    for (size_t row = from; row < to; row += 20) {
        for (int i = 0; i < (row == 0 ? 3 : 1); i++) {
            send_reference(bench, amplitude_um);
        }
        run_touched(bench, to - row < 20 ? to - row : 20, row, phi, decay_1_s);
    }
}

static void drive(bench_t *bench, float amplitude_um, size_t from, size_t to)
{
    const double nowhere[HD_MODES] = {0.0};
    drive_touched(bench, amplitude_um, from, to, nowhere, 0.0);
}

static bool is_off(const bench_t *bench, size_t row)
{
    for (int k = 0; k < HD_MODES; k++) {
        if (cabs(bench->voltage_v[row * HD_MODES + (size_t)k]) > 0.0) {
            return false;
        }
    }
    return true;
}

static void the_plate_follows_its_reference(uint64_t t_start_us, enum hd_law law)
{
    bench_t bench;
    start(&bench, t_start_us, law);
    drive(&bench, 1.0f, 0, 200);
    drive(&bench, 2.0f, 200, ROWS);
    for (int k = 0; k < HD_MODES; k++) {
        expect(cabs(bench.plate_um[199 * HD_MODES + k] - 1.0) < 0.02, "1 um is reached");
        size_t ticks = law == HD_LAW_PI ? 40 : 20;
        size_t row = (200 + ticks) * HD_MODES + (size_t)k;
        expect(cabs(bench.plate_um[row] - 2.0) < 0.04, "a step to 2 um settles within 10 ms, or 20 of the paper's PI");
    }
    hd_board_free(bench.board);
}

static void what_cannot_be_reached_saturates_and_lets_go(enum hd_law law)
{
    bench_t bench;
    start(&bench, 0, law);
    const double phi[HD_MODES] = {1.0};
    drive_touched(&bench, 3.9f, 0, 200, phi, 150.0);
    for (size_t row = 100; row < 200 * HD_MODES; row++) {
        expect(cabs(bench.voltage_v[row]) <= LIMIT_V * (1.0 + 1e-6), "no voltage is above its limit");
    }
    expect((bench.flags[199] & HD_TICK_SATURATED) != 0, "saturation is reported");
    drive_touched(&bench, 1.0f, 200, ROWS, phi, 150.0);
    expect((bench.flags[ROWS - 1] & HD_TICK_SATURATED) == 0, "what can be reached again does not saturate");
    expect(cabs(bench.plate_um[(ROWS - 1) * HD_MODES] - 1.0) < 0.02, "and is reached");
    hd_board_free(bench.board);
}

/* The mode at the frame's own frequency stands still in it; seen from another frame it turns, and nothing jumps. */
static void a_changed_drive_turns_the_frame(void)
{
    const double frame_rad_s = 300.0, span_s = 0.004;
    hd_plate_t plate = {.modes = 1, .decay_1_s = {1e-3}, .detuning_rad_s = {frame_rad_s}, .amplifier_limit_v = 1.0};
    plate.w_um[0] = 1.0;
    const hd_contact_t no_contact = {.stiffest_1_s = 0.0};
    const double complex zero_v[HD_MODES] = {0.0};
    double complex integral_um_s[HD_PLATE_MODES_MAX] = {0.0};
    hd_plate_advance(&plate, &no_contact, zero_v, frame_rad_s, span_s, integral_um_s);
    expect(cabs(plate.w_um[0] - 1.0) < 1e-5, "at the drive's frequency a mode stands still");
    hd_plate_advance(&plate, &no_contact, zero_v, 0.0, span_s, integral_um_s);
    expect(cabs(plate.w_um[0] - cexp(I * frame_rad_s * span_s)) < 1e-4, "detuned, it rotates");
}

static void silence_of_the_host_silences_the_plate(void)
{
    bench_t bench;
    start(&bench, 0xFFFFFFFFu - 30000, HD_LAW_DEADBEAT);
    drive(&bench, 3.0f, 0, 100);
    run(&bench, 200, 100);
    size_t last_frame = 80;
    size_t deadline = last_frame + (HD_DEADMAN_US + HD_RAMP_US) / TICK_US + 1;
    expect((bench.flags[last_frame + 95] & HD_TICK_LIVE) != 0, "the drive stands for the dead-man's time");
    for (size_t row = deadline; row < 300; row++) {
        expect(is_off(&bench, row), "60 ms after the last frame there is no voltage");
    }
    hd_board_free(bench.board);
}

static void a_sensor_that_is_not_a_number_silences_the_plate(void)
{
    bench_t bench;
    start(&bench, 0, HD_LAW_DEADBEAT);
    drive(&bench, 3.0f, 0, 100);
    const double broken[2 * HD_MODES] = {NAN};
    hd_board_fake_measurement(bench.board, broken);
    drive(&bench, 3.0f, 100, 200);
    for (size_t row = 100; row < 200; row++) {
        expect(is_off(&bench, row), "a non-finite measurement stops the output in the same tick");
    }
    hd_board_free(bench.board);
}

static uint32_t noise(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return *state >> 8;
}

static void hostile_bytes_move_nothing(void)
{
    bench_t bench;
    start(&bench, 0, HD_LAW_DEADBEAT);
    uint32_t state = 1;
    for (int round = 0; round < 20000; round++) {
        uint8_t payload[HD_REFERENCE_MAX];
        size_t n = noise(&state) % 64;
        for (size_t i = 0; i < n; i++) {
            payload[i] = (uint8_t)noise(&state);
        }
        if (round % 2 == 0) {
            hd_board_receive(bench.board, payload, n, 0); /* noise on the line */
        } else {
            send(&bench, (uint8_t)(noise(&state) % 8), payload, n); /* a sound frame with senseless contents */
        }
        uint8_t out[2 * HD_TRANSMIT_MIN];
        hd_board_transmit(bench.board, out, sizeof out, 0);
    }
    run(&bench, 1, 0);
    expect(is_off(&bench, 0), "no noise starts the drive");
    hd_board_free(bench.board);
}

/* Frames that fill the receiver's buffer and promise more: the sanitizers see any byte read beyond it. */
static void a_frame_that_promises_more_than_it_has_is_refused(void)
{
    bench_t bench;
    start(&bench, 0, HD_LAW_DEADBEAT);
    uint8_t line[HD_LINE_SIZE(HD_FRAME_MAX) + 8];
    memset(line, 0xFF, sizeof line);
    for (size_t n = 1; n < sizeof line; n++) {
        const uint8_t delimiter = 0;
        hd_board_receive(bench.board, line, n, 0);
        hd_board_receive(bench.board, &delimiter, 1, 0);
    }
    uint8_t out[HD_TRANSMIT_MIN];
    expect(hd_board_transmit(bench.board, out, sizeof out, 0) == 0, "a board answers no broken frame");
    hd_board_free(bench.board);
}

/* Figures of a HELLO are 0 or more and below 1e9: the host refuses a frame with any other. */
static void expect_readable_hello(hd_core_t *core)
{
    uint8_t out[HD_TRANSMIT_MIN];
    size_t frame_n = 0, n = hd_transmit(core, 0, out, sizeof out);
    hd_receiver_t host = {0};
    for (size_t i = 0; i < n && frame_n == 0; i++) {
        hd_receiver_push(&host, out[i], &frame_n);
    }
    hd_wire_hello_t hello;
    expect(frame_n == 1 + sizeof hello && host.bytes[0] == HD_MSG_HELLO, "a misconfigured board answers");
    memcpy(&hello, host.bytes + 1, sizeof hello);
    float figures[] = {hello.control_hz, hello.drive_hz, hello.v_limit_v, hello.w_limit_um[0]};
    for (size_t i = 0; i < sizeof figures / sizeof *figures; i++) {
        expect(figures[i] >= 0.0f && figures[i] < 1e9f, "the host can read the figures of a misconfigured board");
    }
}

static void a_misconfigured_board_answers_and_drives_nothing(void)
{
    const hd_config_t sound = {
        .boot_id = 1, .control_hz = 2000.0f, .drive_hz = 29205.0f, .v_limit_v = 150.0f, .w_limit_um = {4.0f, 4.0f},
    };
    const float bad[] = {NAN, INFINITY, -1.0f, 0.0f, 3e38f};
    for (size_t i = 0; i < 4 * sizeof bad / sizeof *bad; i++) {
        hd_config_t config = sound;
        float *figures[] = {&config.control_hz, &config.drive_hz, &config.v_limit_v, &config.w_limit_um[0]};
        *figures[i % 4] = bad[i / 4];
        hd_core_t core;
        expect(!hd_init(&core, &config, 0) && core.fault == HD_FAULT_CONFIG, "a bad configuration is refused");
        uint8_t line[HD_LINE_SIZE(16)];
        const hd_wire_set_telemetry_t telemetry = {2000};
        hd_receive(&core, line, hd_frame_encode(HD_MSG_HELLO_REQUEST, NULL, 0, line), 0);
        expect_readable_hello(&core);
        hd_receive(&core, line, hd_frame_encode(HD_MSG_SET_TELEMETRY, &telemetry, sizeof telemetry, line), 0);
        const hd_phasor_t measured_um[HD_MODES] = {{1.0f, 0.0f}};
        hd_phasor_t voltage_v[HD_MODES];
        for (uint32_t tick = 1; tick <= 20; tick++) {
            hd_tick(&core, tick * TICK_US, measured_um, voltage_v);
            expect(voltage_v[0].d == 0.0f && voltage_v[0].q == 0.0f, "a misconfigured board drives nothing");
        }
    }
}

int main(void)
{
    for (enum hd_law law = HD_LAW_PI; law <= HD_LAW_DEADBEAT; law++) {
        the_plate_follows_its_reference(0, law);
        the_plate_follows_its_reference(0xFFFFFFFFu - 100000, law);
        what_cannot_be_reached_saturates_and_lets_go(law);
    }
    a_changed_drive_turns_the_frame();
    silence_of_the_host_silences_the_plate();
    a_sensor_that_is_not_a_number_silences_the_plate();
    hostile_bytes_move_nothing();
    a_frame_that_promises_more_than_it_has_is_refused();
    a_misconfigured_board_answers_and_drives_nothing();
    printf("selftest, %d modes: all true\n", HD_MODES);
    return 0;
}
