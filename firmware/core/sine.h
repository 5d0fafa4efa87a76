/* One turn of the circle: a table of integers for every sample, a polynomial for the few values a tick needs.
 *
 * A phase is a uint32_t in 1/2^32 of a turn and wraps as angles do. The table is computed by the compiler from the same
 * polynomial, so host and target hold the same bits, and neither calls libm, whose sines differ between machines.
 *
 * 8192 entries with the phase rounded to the nearest keep the phase within 0.38 mrad, so even at a frequency that meets
 * the same few entries in every period, where rounding does not average out, a demodulated amplitude is right to 0.04 %.
 * 4096 entries would leave twice that.
 */
#ifndef HD_SINE_H
#define HD_SINE_H

#include <stdint.h>

#include "phasor.h"

#define HD_SINE_BITS 13
#define HD_SINE_ENTRIES (1 << HD_SINE_BITS)
#define HD_SINE_ONE 16384 /* what stands for 1: with it a chunk of full-scale samples still sums up in 32 bits */
#define HD_SINE_ROUNDING (1u << (31 - HD_SINE_BITS)) /* add to a phase before hd_sine_at */

/* cos in the lower, -sin in the upper half of each word: the two weights of w(t) = W_d cos - W_q sin. */
extern const uint32_t hd_sine_table[HD_SINE_ENTRIES];

/* The entry at or before a phase; of a phase with HD_SINE_ROUNDING added, the nearest. */
static inline uint32_t hd_sine_at(uint32_t phase)
{
    return hd_sine_table[phase >> (32 - HD_SINE_BITS)];
}

/* e^{j phase}, each part within 1.5e-7. */
hd_phasor_t hd_unit_phasor(uint32_t phase);

#endif
