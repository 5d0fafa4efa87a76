#include "carrier.h"

#include <stddef.h>
#include <string.h>

#include "chunk.h"
#include "dsp.h"
#include "limiter.h"
#include "memory.h"
#include "sine.h"

#define LEVELS_PER_LSB 16.0f
#define LEVEL_MAX (2047.0f * LEVELS_PER_LSB) /* around mid-rail the converter has 2047 steps on its shorter side */
#define MID_RAIL_TWICE 0x10001000u /* of two samples of both modes, in steps */
#define STEP_DIVISOR (HD_SAMPLE_HZ / 64u)

_Static_assert((int64_t)HD_CHUNK * 2048 * HD_SINE_ONE <= INT32_MAX, "a chunk's sums fit 32 bits");
_Static_assert(HD_CHUNK % 2 == 0, "neighbouring samples are added in pairs");
_Static_assert(HD_SAMPLE_HZ == 20000 * HD_CHUNK && HD_SAMPLE_HZ % 64 == 0 && HD_SAMPLE_HZ <= 1000000, "of a chunk, of a step");

static bool positive(float value)
{
    return value > 0.0f && value <= FLT_MAX;
}

static bool drive_valid(float drive_hz)
{
    return drive_hz >= HD_DRIVE_MIN_HZ && drive_hz <= HD_DRIVE_MAX_HZ;
}

/* How many chunks a control tick has; 0 if it has no whole number of them, or too many. */
static uint16_t chunks_per_tick(float control_hz)
{
    const float chunk_hz = (float)HD_SAMPLE_HZ / (float)HD_CHUNK;
    if (!(control_hz * (float)HD_TICK_CHUNKS_MAX >= chunk_hz && control_hz <= chunk_hz)) {
        return 0;
    }
    uint16_t chunks = (uint16_t)(chunk_hz / control_hz + 0.5f);
    bool whole = fabsf((float)chunks * control_hz - chunk_hz) <= 1e-6f * chunk_hz;
    return whole ? chunks : 0;
}

uint32_t hd_oscillator_step(float drive_hz)
{
    /* At 1 MHz 2^32 / 10^6 = 2^26 / 15625. In 1/1024 Hz a float32 of the permitted range is a whole number below 2^28, and
     * the long division by 15625 in digits of 2^16 stays within 32 bits. */
    uint32_t frequency = (uint32_t)(drive_hz * 1024.0f);
    uint32_t whole = frequency / STEP_DIVISOR;
    uint32_t rest = frequency % STEP_DIVISOR;
    return (whole << 16) + ((rest << 16) + STEP_DIVISOR / 2u) / STEP_DIVISOR;
}

/* sum of cos over n instants a step apart, centred on 0: sin(n step/2) / sin(step/2). */
static float centred_sum(uint32_t n, uint64_t step)
{
    float over = hd_unit_phasor((uint32_t)(n * step / 2u)).q;
    return over / hd_unit_phasor((uint32_t)(step / 2u)).q;
}

static hd_least_squares_t least_squares(uint16_t chunks, uint32_t step)
{
    uint32_t n = (uint32_t)chunks * HD_CHUNK / 2u;
    float pairs = (float)n;
    float offset = centred_sum(n, 2u * (uint64_t)step);
    float doubled = centred_sum(n, 4u * (uint64_t)step); /* sum of cos^2 - sin^2 */
    float of_pair = 2.0f * hd_unit_phasor(step / 2u).d; /* cos(x - h) + cos(x + h) = 2 cos(h) cos(x) */
    return (hd_least_squares_t){
        .half_span = (uint32_t)((uint64_t)(2u * n - 1u) * step / 2u),
        .per_sample = 0.5f / pairs,
        .offset_frac = offset / pairs,
        .per_unit = {1.0f / (of_pair * (0.5f * (pairs + doubled) - offset * offset / pairs)),
                     1.0f / (of_pair * 0.5f * (pairs - doubled))},
    };
}

#define WORDS(begin, end) ((uint32_t)(((end) - (begin)) / sizeof(uint32_t)))

/* Of scales, least squares and balance, and of the numbers between them that do not run. */
static inline uint32_t sum_of_settled(const hd_carrier_t *carrier)
{
    return hd_sum_words(carrier->converters.um_per_lsb, HD_MODES)
        + hd_sum_words(carrier->levels_per_v, WORDS(offsetof(hd_carrier_t, levels_per_v), sizeof *carrier))
        + carrier->tick_chunks + carrier->spoken.step;
}

/* Of what another drive changes. */
static uint32_t sum_of_tuned(const hd_carrier_t *carrier)
{
    return hd_sum_words(&carrier->least_squares, sizeof carrier->least_squares / sizeof(uint32_t)) + carrier->spoken.step;
}

bool hd_carrier_intact(const hd_carrier_t *carrier)
{
    return sum_of_settled(carrier) == 0u;
}

bool hd_carrier_init(hd_carrier_t *carrier, const hd_converters_t *converters)
{
    memset(carrier, 0, sizeof *carrier);
    carrier->converters = *converters;
    uint16_t chunks = chunks_per_tick(converters->control_hz);
    carrier->tick_chunks = chunks | (uint32_t)chunks << 16;
    bool valid = chunks > 0 && drive_valid(converters->drive_hz);
    for (int k = 0; k < HD_MODES; k++) {
        valid = valid && positive(converters->volts_per_lsb[k]) && positive(converters->um_per_lsb[k]);
        carrier->levels_per_v[k] = LEVELS_PER_LSB / converters->volts_per_lsb[k];
    }
    if (valid) {
        uint32_t step = hd_oscillator_step(converters->drive_hz);
        carrier->played[0] = carrier->played[1] = carrier->spoken = (hd_oscillation_t){0u, step};
        hd_chunk_advance(&carrier->played[1]);
        carrier->spoken.phase = carrier->played[1].phase;
        hd_chunk_advance(&carrier->spoken);
        carrier->least_squares = least_squares(chunks, step);
        carrier->balance = 0u - sum_of_settled(carrier);
    }
    return valid;
}

void hd_carrier_tune(hd_carrier_t *carrier, float drive_hz)
{
    if (drive_hz != carrier->converters.drive_hz && drive_valid(drive_hz)) {
        carrier->balance += sum_of_tuned(carrier); /* what was damaged before stays so */
        carrier->converters.drive_hz = drive_hz;
        carrier->spoken.step = hd_oscillator_step(drive_hz);
        carrier->least_squares = least_squares((uint16_t)carrier->tick_chunks, carrier->spoken.step);
        carrier->balance -= sum_of_tuned(carrier);
    }
}

static int32_t nearest(float value)
{
    return (int32_t)(value < 0.0f ? value - 0.5f : value + 0.5f);
}

void hd_carrier_drive(hd_carrier_t *carrier, const hd_phasor_t voltage_v[HD_MODES])
{
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t level = hd_limit_magnitude(hd_scale(carrier->levels_per_v[k], voltage_v[k]), LEVEL_MAX);
        carrier->level[k] = hd_finite(level) ? hd_pair(nearest(level.d), nearest(level.q)) : 0u;
    }
}

/* Modes are worked on in pairs, one word per instant as in the registers of a dual DAC and ADC. The last of an odd
 * number of modes has a partner with amplitude zero. */
static inline uint32_t sample_pair(const uint16_t in[HD_MODES], int k)
{
    return k + 1 < HD_MODES ? hd_load_pair(in + k) : in[k] | HD_MID_RAIL << 16;
}

static inline void put_sample_pair(uint16_t out[HD_MODES], int k, uint32_t pair)
{
    if (k + 1 < HD_MODES) {
        hd_store_pair(out + k, pair);
    } else {
        out[k] = (uint16_t)pair;
    }
}

static inline uint32_t sample_of(uint32_t low_level, uint32_t high_level, uint32_t sine)
{
    uint32_t low = (uint32_t)hd_add_products(SAMPLE_BIAS, low_level, sine);
    uint32_t high = (uint32_t)hd_add_products(SAMPLE_BIAS, high_level, sine);
    return hd_pack(high >> (SAMPLE_SHIFT - 16), low, SAMPLE_SHIFT);
}

static void synthesise_pair(hd_oscillation_t at, const uint32_t level[2], int k, uint16_t out[HD_CHUNK][HD_MODES])
{
    const uint32_t low_level = level[0], high_level = level[1];
    uint32_t phase = at.phase + HD_SINE_ROUNDING;
    #pragma GCC unroll 5 /* a taken branch costs as much as two products */
    for (int i = 0; i < HD_CHUNK; i += 2) { /* a load right after another costs half */
        uint32_t first = hd_sine_at(phase), second = hd_sine_at(phase + at.step);
        put_sample_pair(out[i], k, sample_of(low_level, high_level, first));
        put_sample_pair(out[i + 1], k, sample_of(low_level, high_level, second));
        phase += 2u * at.step;
    }
}

void hd_carrier_speak(hd_carrier_t *carrier, uint16_t out[HD_CHUNK][HD_MODES])
{
    for (int k = 0; k < HD_MODES; k += 2) {
        synthesise_pair(carrier->spoken, carrier->level + k, k, out);
    }
    hd_chunk_spoken(carrier);
}

static void demodulate_pair(hd_sums_t sums[2], hd_oscillation_t at, const uint16_t in[HD_CHUNK][HD_MODES], int k)
{
    int32_t low_cosine = 0, low_minus_sine = 0, low_plain = 0;
    int32_t high_cosine = 0, high_minus_sine = 0, high_plain = 0;
    uint32_t phase = at.phase + at.step / 2u + HD_SINE_ROUNDING; /* half-way between two neighbouring samples */
    const uint16_t (*end)[HD_MODES] = in + HD_CHUNK;
    #pragma GCC unroll 5 /* as there */
    for (; in != end; in += 2) {
        uint32_t sine = hd_sine_at(phase); /* before the samples, whose loads then cost half */
        uint32_t x = hd_subtract_halves(sample_pair(in[0], k) + sample_pair(in[1], k), MID_RAIL_TWICE);
        low_cosine = hd_add_low_low(low_cosine, x, sine);
        low_minus_sine = hd_add_low_high(low_minus_sine, x, sine);
        high_cosine = hd_add_high_low(high_cosine, x, sine);
        high_minus_sine = hd_add_high_high(high_minus_sine, x, sine);
        low_plain += hd_low_half(x);
        high_plain += hd_high_half(x);
        phase += 2u * at.step;
    }
    hd_chunk_add(&sums[0], low_cosine, low_minus_sine, low_plain);
    hd_chunk_add(&sums[1], high_cosine, high_minus_sine, high_plain);
}

bool hd_carrier_listen(hd_carrier_t *carrier, const uint16_t in[HD_CHUNK][HD_MODES])
{
    hd_chunk_begin(carrier);
    for (int k = 0; k < HD_MODES; k += 2) {
        demodulate_pair(carrier->sums + k, carrier->played[0], in, k);
    }
    return hd_chunk_end(carrier);
}

/* Turns the product to the tick's middle, takes out the offset, solves, turns back. */
void hd_carrier_measure(const hd_carrier_t *carrier, hd_phasor_t measured_um[HD_MODES])
{
    const hd_least_squares_t *solve = &carrier->least_squares;
    hd_phasor_t middle = hd_unit_phasor(carrier->tick_phase + solve->half_span);
    hd_phasor_t back = {middle.d, -middle.q};
    for (int k = 0; k < HD_MODES; k++) {
        const hd_sums_t *sums = &carrier->sums[k];
        hd_phasor_t product = hd_mul(sums->product, middle);
        product.d -= solve->offset_frac * sums->plain;
        hd_phasor_t amplitude = {solve->per_unit.d * product.d, solve->per_unit.q * product.q};
        measured_um[k] = hd_scale(carrier->converters.um_per_lsb[k], hd_mul(back, amplitude));
    }
}
