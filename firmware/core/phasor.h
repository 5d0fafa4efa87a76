/* A phasor W = d + j q of the rotating frame, w(t) = W_d cos(wt) - W_q sin(wt), in float32.
 *
 * C's own complex type is avoided: without -ffast-math its product calls a library routine that repairs infinities.
 */
#ifndef HD_PHASOR_H
#define HD_PHASOR_H

#include <float.h>
#include <math.h>
#include <stdbool.h>

typedef struct {
    float d;
    float q;
} hd_phasor_t;

static inline hd_phasor_t hd_add(hd_phasor_t a, hd_phasor_t b)
{
    return (hd_phasor_t){a.d + b.d, a.q + b.q};
}

static inline hd_phasor_t hd_sub(hd_phasor_t a, hd_phasor_t b)
{
    return (hd_phasor_t){a.d - b.d, a.q - b.q};
}

static inline hd_phasor_t hd_mul(hd_phasor_t a, hd_phasor_t b)
{
    return (hd_phasor_t){a.d * b.d - a.q * b.q, a.d * b.q + a.q * b.d};
}

static inline hd_phasor_t hd_scale(float factor, hd_phasor_t a)
{
    return (hd_phasor_t){factor * a.d, factor * a.q};
}

static inline hd_phasor_t hd_conj(hd_phasor_t a)
{
    return (hd_phasor_t){a.d, -a.q};
}

static inline float hd_dot(hd_phasor_t a, hd_phasor_t b)
{
    return a.d * b.d + a.q * b.q;
}

static inline hd_phasor_t hd_div(hd_phasor_t a, hd_phasor_t b)
{
    return hd_scale(1.0f / hd_dot(b, b), hd_mul(a, hd_conj(b)));
}

/* Infinite above 1.8e19: everything that compares it then takes the side of silence. */
static inline float hd_magnitude(hd_phasor_t a)
{
    return sqrtf(hd_dot(a, a));
}

/* |a| <= limit, for a limit whose square overflows as little as it underflows; without a square root, which takes as
 * long as a dozen products. False for what is not finite. */
static inline bool hd_within(hd_phasor_t a, float limit)
{
    return hd_dot(a, a) <= limit * limit;
}

/* What is infinite or no number leaves something of itself. (newlib's isfinite is the call of a function.) */
static inline bool hd_finite(hd_phasor_t a)
{
    return (a.d - a.d) + (a.q - a.q) == 0.0f;
}

/* What is sent of a value: the nearest finite one, 0 for NaN. The host refuses a frame with any other. */
static inline float hd_sendable(float value)
{
    return value > FLT_MAX ? FLT_MAX : value < -FLT_MAX ? -FLT_MAX : value == value ? value : 0.0f;
}

/* Returns `a` if `b` is NaN. */
static inline float hd_smaller(float a, float b)
{
    return b < a ? b : a;
}

#endif
