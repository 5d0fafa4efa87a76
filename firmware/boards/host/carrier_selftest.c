/* The signal chain at the edges of its numbers, alone and in the loop: what `make check` runs under the sanitizers. */
#include <complex.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "carrier.h"
#include "codec.h"
#include "lockstep.h"

static void expect(bool condition, const char *what)
{
    if (!condition) {
        printf("carrier selftest, %d modes: NOT TRUE: %s\n", HD_MODES, what);
        exit(1);
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

static uint32_t noise(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return *state >> 8;
}

/* One tick of a square wave from rail to rail, in step with the oscillator: no other input has a larger product. */
static void the_largest_input_overflows_nothing(float control_hz)
{
    hd_carrier_t carrier = new_carrier(control_hz);
    bool complete = false;
    while (!complete) {
        uint16_t in[HD_CHUNK][HD_MODES], out[HD_CHUNK][HD_MODES];
        hd_oscillation_t at = carrier.played[0];
        for (int i = 0; i < HD_CHUNK; i++) {
            uint32_t phase = at.phase + (uint32_t)i * at.step + (1u << 30);
            for (int k = 0; k < HD_MODES; k++) {
                in[i][k] = phase < (1u << 31) ? 0xFFF0u : 0u; /* the sign of the cosine */
            }
        }
        complete = hd_carrier_listen(&carrier, in);
        hd_carrier_speak(&carrier, out);
    }
    hd_phasor_t measured[HD_MODES];
    hd_carrier_measure(&carrier, measured);
    for (int k = 0; k < HD_MODES; k++) {
        float fundamental = 2048.0f * 1.2732395f; /* 4 / pi */
        expect(fabsf(measured[k].d - fundamental) < 0.02f * fundamental, "a square wave has its fundamental");
    }
}

static void no_voltage_wraps(void)
{
    const float voltages[] = {0.0f, -0.0f, 1e-40f, 2047.0f, -2047.0f, 2048.0f, 1e30f, -3.4e38f, INFINITY, NAN};
    const int count = (int)(sizeof voltages / sizeof *voltages);
    hd_carrier_t carrier = new_carrier(2000.0f);
    for (int i = 0; i < count * count; i++) {
        hd_phasor_t voltage_v[HD_MODES];
        for (int k = 0; k < HD_MODES; k++) {
            voltage_v[k] = (hd_phasor_t){voltages[i % count], voltages[i / count]};
        }
        hd_carrier_drive(&carrier, voltage_v);
        uint16_t out[HD_CHUNK][HD_MODES];
        hd_carrier_speak(&carrier, out);
        for (int n = 1; n < HD_CHUNK; n++) {
            int jump = abs((int)out[n][0] - (int)out[n - 1][0]);
            expect(jump < 0x8000 * 0.2, "the step between samples is within the limit of the frequency");
            expect((out[n][HD_MODES - 1] & 0xF) == 0, "a sample has 12 bits");
        }
    }
}

static void any_bits_and_any_frequency_are_survived(void)
{
    hd_carrier_t carrier = new_carrier(20000.0f);
    uint32_t state = 1;
    for (int round = 0; round < 20000; round++) {
        uint16_t in[HD_CHUNK][HD_MODES], out[HD_CHUNK][HD_MODES];
        for (int i = 0; i < HD_CHUNK; i++) {
            for (int k = 0; k < HD_MODES; k++) {
                in[i][k] = (uint16_t)noise(&state);
            }
        }
        float drive_hz;
        uint32_t bits = noise(&state) << 8;
        memcpy(&drive_hz, &bits, sizeof drive_hz);
        expect(hd_carrier_listen(&carrier, in), "a tick of one chunk ends with it");
        hd_phasor_t measured[HD_MODES];
        hd_carrier_measure(&carrier, measured);
        hd_carrier_tune(&carrier, round % 2 == 0 ? drive_hz : (float)(noise(&state) % 300000u));
        hd_carrier_speak(&carrier, out);
        for (int k = 0; k < HD_MODES; k++) {
            expect(hd_finite(measured[k]), "whatever is sampled, the measurement is finite");
        }
    }
}

static hd_board_t *new_board(double amplifier_lag_us)
{
    double decay[HD_MODES], detuning[HD_MODES], gain[HD_MODES * HD_MODES] = {0}, sensor[HD_MODES * HD_MODES] = {0};
    double nominal_gain[HD_MODES], limit_um[HD_MODES], phase[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        decay[k] = 183.5;
        detuning[k] = 62.8 * (k % 2 == 0 ? -1.0 : 1.0);
        nominal_gain[k] = gain[k * HD_MODES + k] = 5.17;
        sensor[k * HD_MODES + k] = 1.0;
        limit_um[k] = 4.0;
        phase[k] = -0.092 - atan(0.1835 * amplifier_lag_us);
    }
    const hd_converter_setup_t converters = {0.0886, 0.0039, 20.0, 1.0, amplifier_lag_us};
    hd_board_setup_t setup = {
        .plate_modes = HD_MODES, .decay_1_s = decay, .detuning_rad_s = detuning, .gain_um_per_v_s = gain,
        .sensor = sensor, .loop_phase_rad = phase, .amplifier_limit_v = 150.0, .seed = 7, .converters = &converters,
        .boot_id = 1, .control_hz = 2000.0, .drive_hz = 29205.0, .v_limit_v = 150.0, .w_limit_um = limit_um,
        .nominal_decay_1_s = decay, .nominal_detuning_rad_s = detuning, .nominal_gain_um_per_v_s = nominal_gain,
        .nominal_loop_phase_rad = phase, .law = HD_LAW_PI_FF,
    };
    return hd_board_new(&setup);
}

static void send_reference(hd_board_t *board, uint16_t seq, float amplitude_um)
{
    struct HD_PACKED {
        hd_wire_reference_t head;
        hd_wire_knot_t knot;
    } message = {{seq, (uint32_t)hd_board_t_us(board), 1, HD_MODES}, {0}};
    for (int k = 0; k < HD_MODES; k++) {
        message.knot.modal[k].d_um = amplitude_um;
    }
    uint8_t line[HD_LINE_SIZE(HD_FRAME_MAX)];
    size_t n = hd_frame_encode(HD_MSG_REFERENCE, &message, sizeof message, line);
    hd_board_receive(board, line, n, hd_board_t_us(board));
}

/* A finger lies on all modes at once, so that they pull at each other. */
static void the_loop_closes_over_real_samples(double amplifier_lag_us)
{
    enum { TICKS = 20, FRAMES = 10 };
    hd_board_t *board = new_board(amplifier_lag_us);
    expect(board != NULL, "a board starts with its converters");
    double complex reference_um[TICKS * HD_MODES], measured_um[TICKS * HD_MODES], plate_um[TICKS * HD_MODES];
    double complex voltage_v[TICKS * HD_MODES];
    uint8_t flags[TICKS];
    hd_board_trace_t trace = {(double *)reference_um, (double *)measured_um, (double *)plate_um, (double *)voltage_v,
                              flags};
    double phi[TICKS * HD_MODES], contact_1_s[TICKS];
    for (int i = 0; i < TICKS * HD_MODES; i++) {
        phi[i] = 0.5;
        contact_1_s[i / HD_MODES] = 40.0;
    }
    for (uint16_t frame = 0; frame < FRAMES + 2; frame++) {
        send_reference(board, frame, 2.0f); /* the third of a stream is trusted */
        if (frame >= 2) {
            hd_board_run(board, TICKS, 1, phi, contact_1_s, NULL, &trace, 0, 0);
        }
    }
    for (int k = 0; k < HD_MODES; k++) {
        expect(cabs(plate_um[(TICKS - 1) * HD_MODES + k] - 2.0) < 0.01, "2 um are reached and held");
    }
    hd_board_free(board);
}

int main(void)
{
    the_largest_input_overflows_nothing(500.0f);
    the_largest_input_overflows_nothing(2000.0f);
    no_voltage_wraps();
    any_bits_and_any_frequency_are_survived();
    the_loop_closes_over_real_samples(0.0);
    the_loop_closes_over_real_samples(0.5);
    expect(new_board(0.01) == NULL && new_board(NAN) == NULL, "an amplifier that cannot be simulated is refused");
    printf("carrier selftest, %d modes: all true\n", HD_MODES);
    return 0;
}
