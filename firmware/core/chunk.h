/* What listening to a chunk and speaking one have in common, however a board lays its samples out (carrier.c, and planar.c
 * and framed.c of the boards). */
#ifndef HD_CHUNK_H
#define HD_CHUNK_H

#include <string.h>

#include "carrier.h"
#include "sine.h"

#define LEVEL_SHIFT 4 /* levels are in 1/16 of a step */
#define SINE_SHIFT 14 /* HD_SINE_ONE */
#define SAMPLE_SHIFT (SINE_SHIFT + LEVEL_SHIFT)

/* A synthesised sample before the shift: mid-rail and half a step, for the nearest one. Never below 0 or above 2^30. */
#define SAMPLE_BIAS ((int32_t)((HD_MID_RAIL << SAMPLE_SHIFT) + (1u << (SAMPLE_SHIFT - 1))))

_Static_assert(HD_SINE_ONE == 1 << SINE_SHIFT, "products are scaled back by a shift");

/* Before the samples of a chunk. */
static inline void hd_chunk_begin(hd_carrier_t *carrier)
{
    if (carrier->chunks == 0) {
        memset(carrier->sums, 0, sizeof carrier->sums);
        carrier->tick_phase = carrier->played[0].phase;
    }
}

/* The sums of a mode over a chunk, of x cos, of -x sin and of x, to those of the tick. */
static inline void hd_chunk_add(hd_sums_t *sums, int32_t cosine, int32_t minus_sine, int32_t plain)
{
    hd_phasor_t product = {(float)cosine, (float)minus_sine};
    sums->product = hd_add(sums->product, hd_scale(1.0f / HD_SINE_ONE, product));
    sums->plain += (float)plain;
}

/* After them; true if the chunk completes a tick. */
static inline bool hd_chunk_end(hd_carrier_t *carrier)
{
    carrier->played[0] = carrier->played[1];
    uint32_t chunks = carrier->chunks + 1u;
    bool complete = chunks >= (carrier->tick_chunks & carrier->tick_chunks >> 16);
    carrier->chunks = complete ? 0u : chunks;
    return complete;
}

static inline void hd_chunk_advance(hd_oscillation_t *oscillation)
{
    oscillation->phase += HD_CHUNK * oscillation->step;
}

/* The next chunk is filled. */
static inline void hd_chunk_spoken(hd_carrier_t *carrier)
{
    carrier->played[1] = carrier->spoken;
    hd_chunk_advance(&carrier->spoken);
}

#endif
