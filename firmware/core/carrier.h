/* Between samples and phasors: what the converters carry at 1 MHz, and what the controller thinks of it at its tick.
 *
 * One oscillator serves both directions. Output: w(t) = W_d cos(wt) - W_q sin(wt) around mid-rail, per mode. Input: least
 * squares of the same three functions (cos, -sin, 1) over a control tick. Integers up to the last division, so every
 * machine gives the same bits.
 *
 * A board moves chunks of HD_CHUNK samples. When one has been sampled, its interrupt calls
 *
 *     if (hd_carrier_listen(&carrier, in)) {       the chunk completes a control tick
 *         hd_carrier_measure(&carrier, measured_um);
 *         hd_tick(&core, now_us, measured_um, voltage_v);
 *         hd_carrier_tune(&carrier, core.drive_hz);
 *         hd_carrier_drive(&carrier, voltage_v);
 *     }
 *     hd_carrier_speak(&carrier, out);
 *
 * and `out` is played after the chunk that is being played now: the new voltage appears HD_CHUNK samples after the end
 * of the measured tick.
 */
#ifndef HD_CARRIER_H
#define HD_CARRIER_H

#include <stdbool.h>
#include <stdint.h>

#include "phasor.h"
#include "protocol.h"

#define HD_SAMPLE_HZ 1000000
#define HD_CHUNK 50 /* samples; both 2 kHz and 5 kHz ticks are whole numbers of chunks */

/* The converters: 12 bits, left-aligned in 16, as the STM32's DAC and ADC take and give them. */
typedef struct {
    float drive_hz;
    float control_hz;
    float volts_per_lsb[HD_MODES]; /* at the amplifier's output, per step of 1/4096 of the converter's range */
    float um_per_lsb[HD_MODES];    /* at the plate, per step of 1/4096 of the converter's range */
} hd_converters_t;

typedef struct {
    hd_converters_t converters;
    uint32_t phase; /* of the next sample to be put out, in 1/2^32 of a turn */
    uint32_t step;
} hd_carrier_t;

/* Returns false if the converters make no sense: rates and scales are positive, a tick is a whole number of chunks. */
bool hd_carrier_init(hd_carrier_t *carrier, const hd_converters_t *converters);

/* Takes a chunk of samples; true when it completes a control tick, for hd_carrier_measure. */
bool hd_carrier_listen(hd_carrier_t *carrier, const uint16_t in[HD_CHUNK][HD_MODES]);

/* The mean amplitudes over the tick just completed. */
void hd_carrier_measure(hd_carrier_t *carrier, hd_phasor_t measured_um[HD_MODES]);

/* Another frequency from the next chunk on; the phase goes on without a jump. */
void hd_carrier_tune(hd_carrier_t *carrier, float drive_hz);

/* The voltages to synthesise from the next chunk on. */
void hd_carrier_drive(hd_carrier_t *carrier, const hd_phasor_t voltage_v[HD_MODES]);

/* Fills the next chunk. */
void hd_carrier_speak(hd_carrier_t *carrier, uint16_t out[HD_CHUNK][HD_MODES]);

#endif
