#include "planar.h"

#include <string.h>

#include "chunk.h"
#include "dsp.h"
#include "sine.h"

#define MID_RAIL_PAIR 0x08000800u
#define ONES 0x00010001u


typedef struct {
    int32_t cosine, minus_sine, plain;
} sums_t;

/* Two neighbouring samples of every mode, which share the sine half-way between them. */
static inline void add_neighbours(sums_t sums[HD_MODES], const uint16_t in[], uint32_t sine)
{
    uint32_t cosines = hd_pair((int32_t)sine, (int32_t)sine);
    uint32_t minus_sines = hd_pack(sine, sine, 16);
    for (int k = 0; k < HD_MODES; k++) {
        uint32_t x = hd_subtract_halves(hd_load_pair(in + k * PLANE), MID_RAIL_PAIR);
        sums[k].cosine = hd_add_products(sums[k].cosine, x, cosines);
        sums[k].minus_sine = hd_add_products(sums[k].minus_sine, x, minus_sines);
        sums[k].plain = hd_add_products(sums[k].plain, x, ONES);
    }
}

static void demodulate(hd_sums_t sums[HD_MODES], hd_oscillation_t at, const uint16_t in[])
{
    sums_t chunk[HD_MODES] = {{0, 0, 0}};
    uint32_t phase = at.phase + at.step / 2u + HD_SINE_ROUNDING;
    #pragma GCC unroll 5
    for (int i = 0; i < HD_CHUNK; i += 2) {
        add_neighbours(chunk, in + i, hd_sine_at(phase));
        phase += 2u * at.step;
    }
    for (int k = 0; k < HD_MODES; k++) {
        hd_chunk_add(&sums[k], chunk[k].cosine, chunk[k].minus_sine, chunk[k].plain);
    }
}

bool planar_listen(hd_carrier_t *carrier, const uint16_t in[])
{
    hd_chunk_begin(carrier);
    demodulate(carrier->sums, carrier->played[0], in);
    return hd_chunk_end(carrier);
}

void planar_speak(hd_carrier_t *carrier, uint16_t out[])
{
    uint32_t level[HD_MODES], step = carrier->spoken.step;
    memcpy(level, carrier->level, sizeof level);
    uint32_t phase = carrier->spoken.phase + HD_SINE_ROUNDING;
    #pragma GCC unroll 5
    for (int i = 0; i < HD_CHUNK; i += 2) {
        uint32_t first = hd_sine_at(phase), second = hd_sine_at(phase + step);
        for (int k = 0; k < HD_MODES; k++) {
            uint32_t low = (uint32_t)hd_add_products(SAMPLE_BIAS, level[k], first);
            uint32_t high = (uint32_t)hd_add_products(SAMPLE_BIAS, level[k], second);
            hd_store_pair(out + k * PLANE + i, hd_pack(high >> (SAMPLE_SHIFT - 16), low, SAMPLE_SHIFT));
        }
        phase += 2u * step;
    }
    hd_chunk_spoken(carrier);
}
