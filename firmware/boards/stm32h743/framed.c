#include "framed.h"

#include <string.h>

#include "chunk.h"
#include "dsp.h"
#include "sine.h"

#define LEVEL_MASK 0xFFF0u
#define MID_RAIL_TWICE 4096

_Static_assert(HD_MODES == 2 * CHIP_MODES && HD_MODES == 6 + SENSORS_3, "two chips of four DACs; three, three and two sensors");

typedef struct {
    int32_t cosine, minus_sine, plain;
} sums_t;

/* Two neighbouring samples, which share the sine half-way between them. */
static inline void add_neighbours(sums_t *sums, uint32_t first, uint32_t second, uint32_t sine)
{
    uint32_t x = (uint32_t)((int32_t)first + (int32_t)second - MID_RAIL_TWICE);
    sums->cosine = hd_add_low_low(sums->cosine, x, sine);
    sums->minus_sine = hd_add_low_high(sums->minus_sine, x, sine);
    sums->plain += (int32_t)x;
}

static void demodulate(hd_sums_t sums[HD_MODES], hd_oscillation_t at, const sampled_t *in)
{
    sums_t chunk[HD_MODES] = {{0, 0, 0}};
    uint32_t phase = at.phase + at.step / 2u + HD_SINE_ROUNDING;
    for (int i = 0; i < HD_CHUNK; i += 2) {
        uint32_t sine = hd_sine_at(phase);
        for (int k = 0; k < 3; k++) {
            add_neighbours(&chunk[k], in->adc1[i][k], in->adc1[i + 1][k], sine);
            add_neighbours(&chunk[3 + k], in->adc2[i][k], in->adc2[i + 1][k], sine);
        }
        for (int k = 0; k < SENSORS_3; k++) {
            add_neighbours(&chunk[6 + k], in->adc3[i][k], in->adc3[i + 1][k], sine);
        }
        phase += 2u * at.step;
    }
    for (int k = 0; k < HD_MODES; k++) {
        hd_chunk_add(&sums[k], chunk[k].cosine, chunk[k].minus_sine, chunk[k].plain);
    }
}

bool framed_listen(hd_carrier_t *carrier, const sampled_t *in)
{
    hd_chunk_begin(carrier);
    demodulate(carrier->sums, carrier->played[0], in);
    return hd_chunk_end(carrier);
}

static inline uint32_t level_at(uint32_t level, uint32_t sine)
{
    return (uint32_t)hd_add_products(SAMPLE_BIAS, level, sine) >> SINE_SHIFT & LEVEL_MASK;
}

void framed_speak(hd_carrier_t *carrier, words_t *out[2])
{
    static const uint32_t command[CHIP_MODES] = {WORD_STORE(0), WORD_STORE(1), WORD_STORE(2), WORD_STORE_4TH_AND_MOVE};
    uint32_t level[HD_MODES], step = carrier->spoken.step;
    memcpy(level, carrier->level, sizeof level);
    uint32_t phase = carrier->spoken.phase + HD_SINE_ROUNDING;
    for (int i = 0; i < HD_CHUNK; i++) {
        uint32_t sine = hd_sine_at(phase);
        for (int k = 0; k < CHIP_MODES; k++) {
            (*out[0])[i][k] = command[k] | level_at(level[k], sine);
            (*out[1])[i][k] = command[k] | level_at(level[CHIP_MODES + k], sine);
        }
        phase += step;
    }
    hd_chunk_spoken(carrier);
}
