/* The firmware against a simulated plate, in C alone: what `make check` runs under the sanitizers. What the loop is worth is
 * tested in Python on the same sources; the fuzzer looks for bytes that do harm. */
#include <complex.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "carrier.h"
#include "codec.h"
#include "core.h"
#include "lockstep.h"

#define TICK_US 500
#define FRAME_TICKS 20 /* a host that sends a reference every 10 ms */

typedef struct {
    hd_board_t *board;
    uint16_t seq;
    double complex reference_um[FRAME_TICKS * HD_MODES], measured_um[FRAME_TICKS * HD_MODES];
    double complex plate_um[FRAME_TICKS * HD_MODES], voltage_v[FRAME_TICKS * HD_MODES];
    uint8_t flags[FRAME_TICKS];
} bench_t;

static void expect(bool condition, const char *what)
{
    if (!condition) {
        printf("selftest, %d modes: NOT TRUE: %s\n", HD_MODES, what);
        exit(1);
    }
}

/* A plate that is as the firmware believes; seen as envelopes, or through these converters. */
static hd_board_t *new_board(uint64_t t_start_us, enum hd_law law, const hd_converter_setup_t *converters)
{
    double decay[HD_MODES], detuning[HD_MODES], gain[HD_MODES * HD_MODES] = {0}, sensor[HD_MODES * HD_MODES] = {0};
    double nominal_gain[HD_MODES], limit_um[HD_MODES], phase[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        decay[k] = 183.5;
        detuning[k] = 62.8 * (k % 2 == 0 ? -1.0 : 1.0);
        nominal_gain[k] = gain[k * HD_MODES + k] = 5.17;
        sensor[k * HD_MODES + k] = 1.0;
        limit_um[k] = 4.0;
        phase[k] = converters == NULL ? 0.3 * (k - 1) : -0.092 - atan(0.1835 * converters->amplifier_lag_us);
    }
    const hd_board_setup_t setup = {
        .plate_modes = HD_MODES, .decay_1_s = decay, .detuning_rad_s = detuning, .gain_um_per_v_s = gain,
        .sensor = sensor, .loop_phase_rad = phase, .noise_um = 0.0006, .amplifier_limit_v = 150.0, .seed = 7,
        .converters = converters, .t_start_us = t_start_us, .boot_id = 1, .control_hz = 1e6 / TICK_US,
        .drive_hz = 29205.0, .v_limit_v = 150.0, .w_limit_um = limit_um, .nominal_decay_1_s = decay,
        .nominal_detuning_rad_s = detuning, .nominal_gain_um_per_v_s = nominal_gain, .nominal_loop_phase_rad = phase,
        .law = (int32_t)law,
    };
    return hd_board_new(&setup);
}

static void run_frame(bench_t *bench, double contact_1_s)
{
    double phi[FRAME_TICKS * HD_MODES], contacts_1_s[FRAME_TICKS];
    for (int i = 0; i < FRAME_TICKS * HD_MODES; i++) {
        phi[i] = 0.5; /* on all modes at once, so that they pull at each other */
        contacts_1_s[i / HD_MODES] = contact_1_s;
    }
    const hd_board_trace_t trace = {(double *)bench->reference_um, (double *)bench->measured_um,
                                    (double *)bench->plate_um, (double *)bench->voltage_v, bench->flags};
    hd_board_run(bench->board, FRAME_TICKS, 1, phi, contacts_1_s, NULL, &trace, 0, 0);
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
    uint8_t line[HD_LINE_SIZE(HD_FRAME_MAX)];
    size_t n = hd_frame_encode(HD_MSG_REFERENCE, &message, sizeof message, line);
    hd_board_receive(bench->board, line, n, hd_board_t_us(bench->board));
}

static void drive(bench_t *bench, float amplitude_um, int frames, double contact_1_s)
{
    for (int frame = 0; frame < frames; frame++) {
        send_reference(bench, amplitude_um);
        run_frame(bench, contact_1_s);
    }
}

static bool is_off(const bench_t *bench)
{
    double sum_v = 0.0;
    for (int i = 0; i < FRAME_TICKS * HD_MODES; i++) {
        sum_v += cabs(bench->voltage_v[i]);
    }
    return sum_v == 0.0;
}

/* Steps, saturation, a silent host, a sensor that is no number: each row of the last frame is looked at. */
static void a_session(uint64_t t_start_us, enum hd_law law, const hd_converter_setup_t *converters)
{
    const double broken[2 * HD_MODES] = {NAN};
    bench_t bench = {.board = new_board(t_start_us, law, converters)};
    expect(bench.board != NULL, "a board starts with a sensible setup");
    send_reference(&bench, 1.0f);
    send_reference(&bench, 1.0f); /* the third of a stream is trusted */
    drive(&bench, 1.0f, 8, 40.0);
    drive(&bench, 2.0f, 4, 40.0);
    for (int k = 0; k < HD_MODES; k++) {
        double off_um = cabs(bench.plate_um[(FRAME_TICKS - 1) * HD_MODES + k] - 2.0);
        expect(off_um < (law == HD_LAW_PI ? 0.08 : 0.04), "2 um are reached and held");
    }
    drive(&bench, 3.9f, 6, 300.0);
    expect((bench.flags[FRAME_TICKS - 1] & HD_TICK_SATURATED) != 0, "saturation is reported");
    drive(&bench, 1.0f, 8, 40.0);
    expect((bench.flags[FRAME_TICKS - 1] & HD_TICK_SATURATED) == 0, "and ends");
    for (int frame = 0; frame < 8; frame++) {
        run_frame(&bench, 0.0);
    }
    expect(is_off(&bench), "a silent host leads to a silent plate");
    drive(&bench, 3.0f, 8, 0.0);
    expect(!is_off(&bench), "a host that comes back is trusted again");
    hd_board_fake_measurement(bench.board, broken);
    drive(&bench, 3.0f, 1, 0.0);
    expect(is_off(&bench), "a measurement that is not finite stops the output in the same tick");
    hd_board_reset(bench.board, 2, HD_RESET_WATCHDOG);
    hd_board_free(bench.board);
}

/* Frames that fill the receiver's buffer and promise more: the sanitizers see any byte read beyond it. */
static void a_frame_that_promises_more_than_it_has_is_refused(void)
{
    hd_board_t *board = new_board(0, HD_LAW_DEADBEAT, NULL);
    uint8_t line[HD_LINE_SIZE(HD_FRAME_MAX) + 8], out[HD_TRANSMIT_MIN];
    const uint8_t delimiter = 0;
    memset(line, 0xFF, sizeof line);
    for (size_t n = 1; n < sizeof line; n++) {
        hd_board_receive(board, line, n, 0);
        hd_board_receive(board, &delimiter, 1, 0);
    }
    expect(hd_board_transmit(board, out, sizeof out, 0) == 0, "a board answers no broken frame");
    hd_board_free(board);
}

/* Figures of a HELLO are 0 or more and below 1e9: the host refuses a frame with any other. */
static void a_misconfigured_board_answers_and_drives_nothing(void)
{
    const float bad[] = {NAN, INFINITY, -1.0f, 0.0f, 3e38f};
    for (size_t i = 0; i < 4 * sizeof bad / sizeof *bad; i++) {
        hd_config_t config = {
            .boot_id = 1, .control_hz = 2000.0f, .drive_hz = 29205.0f, .v_limit_v = 150.0f, .w_limit_um = {4.0f, 4.0f},
        };
        float *figures[] = {&config.control_hz, &config.drive_hz, &config.v_limit_v, &config.w_limit_um[0]};
        *figures[i % 4] = bad[i / 4];
        hd_core_t core;
        expect(!hd_init(&core, &config, 0) && core.fault == HD_FAULT_CONFIG, "a bad configuration is refused");
        uint8_t line[HD_LINE_SIZE(16)];
        const hd_wire_set_telemetry_t telemetry = {2000};
        hd_receive(&core, line, hd_frame_encode(HD_MSG_SET_TELEMETRY, &telemetry, sizeof telemetry, line), 0);
        hd_receive(&core, line, hd_frame_encode(HD_MSG_HELLO_REQUEST, NULL, 0, line), 0);
        hd_message_t message;
        expect(hd_say(&core, 0, &message) && message.type == HD_MSG_HELLO, "a misconfigured board answers");
        const hd_wire_hello_t *hello = &message.payload.hello;
        const float said[] = {hello->control_hz, hello->drive_hz, hello->v_limit_v, hello->w_limit_um[0]};
        for (size_t k = 0; k < 4; k++) {
            expect(said[k] >= 0.0f && said[k] < 1e9f, "the host can read the figures of a misconfigured board");
        }
        const hd_phasor_t measured_um[HD_MODES] = {{1.0f, 0.0f}};
        hd_phasor_t voltage_v[HD_MODES];
        for (uint32_t tick = 1; tick <= 20; tick++) {
            hd_tick(&core, tick * TICK_US, measured_um, voltage_v);
            expect(voltage_v[0].d == 0.0f && voltage_v[0].q == 0.0f, "a misconfigured board drives nothing");
        }
    }
}

static hd_carrier_t new_carrier(float control_hz)
{
    hd_converters_t converters = {.drive_hz = 29205.0f, .control_hz = control_hz};
    for (int k = 0; k < HD_MODES; k++) {
        converters.volts_per_lsb[k] = converters.um_per_lsb[k] = 1.0f;
    }
    hd_carrier_t carrier;
    expect(hd_carrier_init(&carrier, &converters), "a carrier starts with sensible converters");
    return carrier;
}

/* One tick of a square wave from rail to rail, in step with the oscillator: no other input has a larger product. */
static void the_largest_input_overflows_nothing(void)
{
    hd_carrier_t carrier = new_carrier(500.0f);
    uint16_t in[HD_CHUNK][HD_MODES], out[HD_CHUNK][HD_MODES];
    do {
        hd_carrier_speak(&carrier, out);
        hd_oscillation_t at = carrier.played[0];
        for (uint32_t i = 0; i < HD_CHUNK * HD_MODES; i++) {
            bool high = at.phase + i / HD_MODES * at.step + (1u << 30) < 1u << 31; /* the sign of the cosine */
            in[i / HD_MODES][i % HD_MODES] = high ? 0xFFFu : 0u;
        }
    } while (!hd_carrier_listen(&carrier, in));
    hd_phasor_t measured[HD_MODES];
    hd_carrier_measure(&carrier, measured);
    float fundamental = 2048.0f * 1.2732395f; /* 4 / pi */
    expect(fabsf(measured[HD_MODES - 1].d - fundamental) < 0.02f * fundamental, "a square wave has its fundamental");
}

static uint32_t noise(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return *state >> 8;
}

static float any_float(uint32_t *state)
{
    float value;
    uint32_t bits = noise(state) << 8;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void any_bits_voltage_and_frequency_are_survived(void)
{
    hd_carrier_t carrier = new_carrier(20000.0f);
    uint32_t state = 1;
    for (int round = 0; round < 20000; round++) {
        uint16_t in[HD_CHUNK][HD_MODES], out[HD_CHUNK][HD_MODES];
        hd_phasor_t measured[HD_MODES], voltage_v[HD_MODES];
        for (int i = 0; i < HD_CHUNK * HD_MODES; i++) {
            in[i / HD_MODES][i % HD_MODES] = (uint16_t)noise(&state);
        }
        for (int k = 0; k < HD_MODES; k++) {
            voltage_v[k] = (hd_phasor_t){any_float(&state), any_float(&state)};
        }
        expect(hd_carrier_listen(&carrier, in), "a tick of one chunk ends with it");
        hd_carrier_measure(&carrier, measured);
        hd_carrier_tune(&carrier, round % 2 == 0 ? any_float(&state) : (float)(noise(&state) % 300000u));
        hd_carrier_drive(&carrier, voltage_v);
        hd_carrier_speak(&carrier, out);
        for (int k = 0; k < HD_MODES; k++) {
            expect(hd_finite(measured[k]), "whatever is sampled, the measurement is finite");
            expect(out[HD_CHUNK - 1][k] >> 12 == 0, "a sample has 12 bits");
        }
    }
}

int main(void)
{
    hd_converter_setup_t converters = {0.0886, 0.0039, 20.0, 1.0, 0.5};
    for (enum hd_law law = HD_LAW_PI; law <= HD_LAW_DEADBEAT; law++) {
        a_session(0xFFFFFFFFu - 100000, law, NULL); /* the clock wraps */
    }
    a_session(0, HD_LAW_PI_FF, &converters);
    converters.amplifier_lag_us = 0.01;
    expect(new_board(0, HD_LAW_PI_FF, &converters) == NULL, "an amplifier that cannot be simulated is refused");
    a_frame_that_promises_more_than_it_has_is_refused();
    a_misconfigured_board_answers_and_drives_nothing();
    the_largest_input_overflows_nothing();
    any_bits_voltage_and_frequency_are_survived();
    printf("selftest, %d modes: all true\n", HD_MODES);
    return 0;
}
