#include "resonators.h"

#include <string.h>

#define TURN_RAD 6.283185307179586
#define SAMPLE_S (1.0 / HD_SAMPLE_HZ)
#define HALF_RANGE 2048 /* 12-bit converters around mid-rail, left-aligned in 16 */
#define ALIGN 4
#define SERIES_TERMS 16 /* of e^x for |x| of 0.2: far below float32 */

/* Where a decaying amplitude ends: numbers that lose their precision near zero cost an emulator dearly. */
#define SILENT_LSB 1e-6f

typedef struct {
    double re;
    double im;
} number_t;

static number_t product(number_t a, number_t b)
{
    return (number_t){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

/* (e^x - 1) / x and e^x, by the series: neither subtracts what it has just added, and no library is needed. */
static number_t series(number_t x, int first)
{
    number_t sum = {1.0, 0.0}, term = {1.0, 0.0};
    for (int n = 1; n < SERIES_TERMS; n++) {
        term = product(term, x);
        term = (number_t){term.re / (n + first), term.im / (n + first)};
        sum = (number_t){sum.re + term.re, sum.im + term.im};
    }
    return sum;
}

void hd_resonators_init(hd_resonators_t *plate, const hd_resonance_t resonance[HD_MODES],
                        const hd_converters_t *converters)
{
    memset(plate, 0, sizeof *plate);
    for (int k = 0; k < HD_MODES; k++) {
        const hd_resonance_t *mode = &resonance[k];
        number_t x = {-(double)mode->decay_1_s * SAMPLE_S, TURN_RAD * (double)mode->frequency_hz * SAMPLE_S};
        number_t turn = series(x, 0), held = series(x, 1);
        double kick = 2.0 * (double)mode->gain_um_per_v_s * SAMPLE_S * (double)converters->volts_per_lsb[k]
            / (double)converters->um_per_lsb[k];
        plate->um_per_lsb[k] = converters->um_per_lsb[k];
        plate->mode[k] = (hd_resonator_t){
            .turn_d = (float)turn.re, .turn_q = (float)turn.im,
            .kick_d = (float)(kick * held.re), .kick_q = (float)(kick * held.im),
            .clip_lsb = (int)(mode->amplifier_limit_v / converters->volts_per_lsb[k]),
        };
    }
}

static int clamp(int value, int low, int high)
{
    return value < low ? low : value > high ? high : value;
}

static void play_mode(hd_resonator_t *mode, int k, const uint16_t out[HD_CHUNK][HD_MODES],
                      uint16_t in[HD_CHUNK][HD_MODES])
{
    float d = mode->d, q = mode->q;
    if (d * d + q * q < SILENT_LSB * SILENT_LSB) {
        d = q = 0.0f;
    }
    for (int n = 0; n < HD_CHUNK; n++) {
        int sensed = clamp((int)(q + (HALF_RANGE + 0.5f)), 0, 2 * HALF_RANGE - 1);
        float driven = (float)clamp((out[n][k] >> ALIGN) - HALF_RANGE, -mode->clip_lsb, mode->clip_lsb);
        in[n][k] = (uint16_t)(sensed << ALIGN);
        float turned_d = mode->turn_d * d - mode->turn_q * q;
        q = mode->turn_d * q + mode->turn_q * d + mode->kick_q * driven;
        d = turned_d + mode->kick_d * driven;
    }
    mode->d = d;
    mode->q = q;
}

void hd_resonators_play(hd_resonators_t *plate, const uint16_t out[HD_CHUNK][HD_MODES],
                        uint16_t in[HD_CHUNK][HD_MODES])
{
    for (int k = 0; k < HD_MODES; k++) {
        play_mode(&plate->mode[k], k, out, in);
    }
}

/* w = Im y = Re(W e^(j theta)), so W = -j y e^(-j theta). */
hd_phasor_t hd_resonators_amplitude_um(const hd_resonators_t *plate, int mode, hd_phasor_t oscillator)
{
    const hd_resonator_t *resonator = &plate->mode[mode];
    hd_phasor_t ahead = {resonator->q, -resonator->d};
    return hd_scale(plate->um_per_lsb[mode], hd_mul(ahead, (hd_phasor_t){oscillator.d, -oscillator.q}));
}
