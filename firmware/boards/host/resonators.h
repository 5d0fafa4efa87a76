/* A vibrating plate between a DAC and an ADC, sample by sample at the carrier's rate.
 *
 *   w'' + 2 sigma w' + (omega^2 + sigma^2) w = 2 omega g v      each mode with its own amplifier and its own sensor
 *
 * has the solution w = Im y of y' = (-sigma + j omega) y + 2 g v, which one complex product a sample advances exactly
 * while the converter holds its voltage. The rotating frame then sees dW/dt = (-sigma + j delta) W - j g V, but for
 * terms of the order sigma / omega. float32: an emulated Cortex-M4 has to do it a million times a second.
 *
 * Left out: fingers, the neighbouring modes, what one amplifier or sensor sees of the other mode, the lag of amplifiers
 * and filters, and all noise but the steps of 12-bit converters.
 */
#ifndef HD_RESONATORS_H
#define HD_RESONATORS_H

#include <stdint.h>

#include "carrier.h"

typedef struct {
    float frequency_hz;
    float decay_1_s;
    float gain_um_per_v_s;
    float amplifier_limit_v; /* an amplifier clips what the converters ask beyond it */
} hd_resonance_t;

typedef struct {
    float turn_d, turn_q; /* e^((-sigma + j omega) T) for T of one sample */
    float kick_d, kick_q; /* what one step of the DAC adds in a sample, in steps of the ADC */
    float d, q;           /* y, in steps of the ADC */
    int clip_lsb;
} hd_resonator_t;

typedef struct {
    hd_resonator_t mode[HD_MODES];
    float um_per_lsb[HD_MODES];
} hd_resonators_t;

void hd_resonators_init(hd_resonators_t *plate, const hd_resonance_t resonance[HD_MODES],
                        const hd_converters_t *converters);

/* Plays one chunk and samples the plate: in[n] is what the plate does as out[n] begins to act. */
void hd_resonators_play(hd_resonators_t *plate, const uint16_t out[HD_CHUNK][HD_MODES],
                        uint16_t in[HD_CHUNK][HD_MODES]);

/* The amplitude now, in the frame of an oscillator that stands at e^(j theta). */
hd_phasor_t hd_resonators_amplitude_um(const hd_resonators_t *plate, int mode, hd_phasor_t oscillator);

#endif
