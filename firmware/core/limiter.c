#include "limiter.h"

/* Comparisons are written so that NaN falls on the side of silence: `!(x <= limit)` is true for it. */

#define ROUND_DOWN (1.0f - 0x1p-21f) /* outweighs the roundings of a square root, a quotient and a product */

static bool all_finite(const hd_phasor_t phasor[HD_MODES])
{
    for (int k = 0; k < HD_MODES; k++) {
        if (!hd_finite(phasor[k])) {
            return false;
        }
    }
    return true;
}

static void scale_all(hd_phasor_t phasor[HD_MODES], float factor)
{
    for (int k = 0; k < HD_MODES; k++) {
        phasor[k] = hd_scale(factor, phasor[k]);
    }
}

static hd_limit_t silence(hd_phasor_t phasor[HD_MODES])
{
    for (int k = 0; k < HD_MODES; k++) {
        phasor[k] = (hd_phasor_t){0.0f, 0.0f};
    }
    return HD_LIMIT_NOT_FINITE;
}

hd_limit_t hd_limit_amplitudes(hd_phasor_t modal_um[HD_MODES], const float limit_um[HD_MODES])
{
    if (!all_finite(modal_um)) {
        return silence(modal_um);
    }
    float factor = 1.0f;
    for (int k = 0; k < HD_MODES; k++) {
        float magnitude = hd_magnitude(modal_um[k]);
        if (!(magnitude <= limit_um[k] * (1.0f + HD_LIMIT_TOLERANCE))) {
            factor = hd_smaller(factor, ROUND_DOWN * limit_um[k] / magnitude);
        }
    }
    if (factor == 1.0f) {
        return HD_LIMIT_UNTOUCHED;
    }
    scale_all(modal_um, factor);
    return HD_LIMIT_SCALED;
}

hd_phasor_t hd_shorten(hd_phasor_t value, float limit)
{
    return hd_scale(ROUND_DOWN * limit / hd_magnitude(value), value);
}

hd_limit_t hd_limit_voltages(hd_phasor_t voltage_v[HD_MODES], float limit_v)
{
    bool within = true;
    for (int k = 0; k < HD_MODES; k++) {
        within = within && hd_within(voltage_v[k], limit_v);
    }
    if (within) {
        return HD_LIMIT_UNTOUCHED;
    }
    if (!all_finite(voltage_v)) {
        return silence(voltage_v);
    }
    for (int k = 0; k < HD_MODES; k++) {
        voltage_v[k] = hd_limit_magnitude(voltage_v[k], limit_v);
    }
    return HD_LIMIT_SCALED;
}
