/* Between samples and phasors: what the converters carry at 1 MHz, and what the controller thinks of it at its tick.
 *
 * One oscillator serves both directions. Output: v(t) = V_d cos(wt) - V_q sin(wt) around mid-rail, per mode. Input: the
 * least squares of the same three functions (cos, -sin, 1) over a control tick. Pairs of samples are added before they
 * are multiplied: half the products, for 1 - cos(w / 2 MHz) of the signal in the noise, 0.4 % at 29 kHz (4 % at 320 kHz). Samples are
 * integers; sums over a chunk are exact, and what follows is float32 in a fixed order: every machine gives the same bits.
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
 * of the measured tick. The chunk just sampled is thus two older than the next output; the first two that a board plays
 * are mid-rail.
 *
 * An amplitude W or V is that of the phasor, wherever it is read from the signal: with W in um peak to peak, as
 * everywhere here, um_per_lsb is twice the displacement that moves the converter by a step.
 */
#ifndef HD_CARRIER_H
#define HD_CARRIER_H

#include <stdbool.h>
#include <stdint.h>

#include "phasor.h"
#include "protocol.h"

/* Of the converters, by the board (firmware/Makefile): chunks take 50 us, so that both 2 kHz and 5 kHz ticks are whole numbers
 * of them. */
#ifndef HD_SAMPLE_HZ
#define HD_SAMPLE_HZ 1000000
#endif
#define HD_CHUNK (HD_SAMPLE_HZ / 20000) /* samples, in pairs */
#define HD_TICK_CHUNKS_MAX 40 /* 500 Hz, the slowest control */
#define HD_MID_RAIL 0x800u    /* what stands for 0 in the converters */
#define HD_RAIL_LSB 2047.0f   /* from mid-rail, on its shorter side */
#define HD_PAIRED_MODES ((HD_MODES + 1) / 2 * 2)

/* A turn within a chunk at least: with fewer, amplitude and offset are indistinguishable. Eight samples to
 * a turn at least: neighbouring samples that are added must not have opposite signs. */
#define HD_DRIVE_MIN_HZ 20000.0f
#define HD_DRIVE_MAX_HZ ((float)HD_SAMPLE_HZ / 8.0f)

/* The converters: 12 bits, right-aligned in 16 as the STM32's DAC and ADC take and give them: no sample is shifted. */
typedef struct {
    float drive_hz;
    float control_hz;
    float volts_per_lsb[HD_MODES]; /* at the amplifier's output, per step of 1/4096 of the converter's range */
    float um_per_lsb[HD_MODES];    /* at the plate, per step of 1/4096 of the converter's range */
} hd_converters_t;

/* The phase of a chunk's first sample and the advance per sample, in 1/2^32 of a turn. */
typedef struct {
    uint32_t phase;
    uint32_t step;
} hd_oscillation_t;

/* Over sums x of two neighbouring samples, in steps of the converter: sum of x cos, of -x sin, and of x. */
typedef struct {
    hd_phasor_t product;
    float plain;
} hd_sums_t;

/* The least squares of a tick at one frequency. Seen from the tick's middle, cosine and sine are orthogonal, and what
 * is left of the normal equations are these. */
typedef struct {
    uint32_t half_span; /* phase from the first sample to the middle */
    float per_sample;     /* one over the samples of a tick */
    float offset_frac;    /* mean of the cosine: what a constant adds to the product, of its plain sum */
    hd_phasor_t per_unit; /* amplitude per unit of the product: of the cosine with the constant removed, of the sine */
} hd_least_squares_t;

typedef struct {
    hd_converters_t converters;      /* with the drive as it is now */
    hd_oscillation_t spoken;         /* of the next output chunk */
    hd_oscillation_t played[2];      /* of the chunk being sampled, and of the next */
    uint32_t level[HD_PAIRED_MODES]; /* V_d and V_q as hd_pair, in 1/16 of a step of the converter */

    uint32_t tick_chunks; /* in either half: with a longer tick the voltage would stand, so that a bit set in one counts for nothing */
    uint32_t chunks;      /* of this tick, so far */
    uint32_t tick_phase; /* of its first sample */
    hd_sums_t sums[HD_PAIRED_MODES];
    float levels_per_v[HD_MODES];
    hd_least_squares_t least_squares;
    uint32_t balance; /* brings the sum of all that is settled until the next other drive to 0 (memory.h) */
} hd_carrier_t;

/* Returns false if the converters make no sense: scales are positive, the drive is in its range, and a tick is a whole
 * number of chunks, HD_TICK_CHUNKS_MAX at most. */
bool hd_carrier_init(hd_carrier_t *carrier, const hd_converters_t *converters);

/* Takes a chunk of samples; true when it completes a control tick, for hd_carrier_measure. */
bool hd_carrier_listen(hd_carrier_t *carrier, const uint16_t in[HD_CHUNK][HD_MODES]);

/* The mean amplitudes over the tick just completed. */
void hd_carrier_measure(const hd_carrier_t *carrier, hd_phasor_t measured_um[HD_MODES]);

/* Whether samples of mode k, which measured so much, met a rail of the converter: a wave that was cut there has lost more of
 * its crests than of its mean and its fundamental, so that the two together still reach beyond the rail. */
static inline bool hd_carrier_clips(const hd_carrier_t *carrier, int k, hd_phasor_t measured_um)
{
    float room_lsb = HD_RAIL_LSB - carrier->least_squares.per_sample * fabsf(carrier->sums[k].plain);
    return !(room_lsb > 0.0f && hd_within(measured_um, room_lsb * carrier->converters.um_per_lsb[k]));
}

/* False if a bit of scales, least squares or step has turned over since they were set. */
bool hd_carrier_intact(const hd_carrier_t *carrier);

/* Another frequency from the next chunk on; the phase goes on without a jump. Out of range, the old one stays. The tick
 * in which the change arrives is measured as if it had the new frequency throughout. */
void hd_carrier_tune(hd_carrier_t *carrier, float drive_hz);

/* The voltages to synthesise from the next chunk on: each axis rounded to 1/16 of a step, each sample to a step. What
 * the converter cannot give keeps its phase, and what is not finite is zero. */
void hd_carrier_drive(hd_carrier_t *carrier, const hd_phasor_t voltage_v[HD_MODES]);

/* Fills the next chunk. */
void hd_carrier_speak(hd_carrier_t *carrier, uint16_t out[HD_CHUNK][HD_MODES]);

/* round(f / HD_SAMPLE_HZ 2^32), exactly: 0.23 mHz fine, finer than float32 above 4096 Hz. */
uint32_t hd_oscillator_step(float drive_hz);

#endif
