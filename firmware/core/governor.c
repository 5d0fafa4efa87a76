#include "governor.h"

/* Share of the voltage that may go into holding an amplitude. Without the rest a mode at its limit could not move at
 * all, and because all modes move by one fraction it would hold up the others. */
#define HOLDABLE_FRAC 0.97f

float hd_holdable_fraction(const hd_wires_t *wires, const hd_phasor_t holding_v[HD_MODES], float v_limit_v)
{
    hd_phasor_t mixed_v[HD_MODES];
    const hd_phasor_t *load_v = hd_wiring_loads_v(wires, holding_v, mixed_v);
    float fraction = 1.0f;
    for (int k = 0; k < HD_MODES; k++) {
        if (!hd_within(load_v[k], HOLDABLE_FRAC * v_limit_v)) {
            fraction = hd_smaller(fraction, HOLDABLE_FRAC * v_limit_v / hd_magnitude(load_v[k]));
        }
    }
    return fraction;
}

/* The same for one amplifier, where |stay| < limit. */
static float amplifier_fraction(hd_phasor_t stay, hd_phasor_t move, float limit)
{
    float a = hd_dot(move, move), b = hd_dot(stay, move), c = hd_dot(stay, stay) - limit * limit;
    if (!(a + 2.0f * b + c > 0.0f)) {
        return 1.0f;
    }
    float root = sqrtf(b * b - a * c);
    float f = b > 0.0f ? -c / (b + root) : (root - b) / a; /* no difference of near equals in either */
    return f > 0.0f ? hd_smaller(1.0f, f) : 0.0f;
}

float hd_feasible_fraction(const hd_wires_t *wires, const hd_phasor_t stay_v[HD_MODES],
                           const hd_phasor_t move_v[HD_MODES], float v_limit_v)
{
    hd_phasor_t mixed_v[2][HD_MODES];
    const hd_phasor_t *staying_v = hd_wiring_loads_v(wires, stay_v, mixed_v[0]);
    const hd_phasor_t *moving_v = hd_wiring_loads_v(wires, move_v, mixed_v[1]);
    float fraction = 1.0f;
    for (int k = 0; k < HD_MODES; k++) {
        if (hd_within(hd_add(staying_v[k], moving_v[k]), v_limit_v)) {
            continue; /* as it is nearly always */
        }
        /* A falling limit, on the ramp to silence, or a finger that lands may leave an amplifier above it: it must get
         * away from there, and must not hold up the others. */
        float least_v = hd_magnitude(staying_v[k]) + (1.0f - HOLDABLE_FRAC) * v_limit_v;
        float budget_v = least_v > v_limit_v ? least_v : v_limit_v;
        fraction = hd_smaller(fraction, amplifier_fraction(staying_v[k], moving_v[k], budget_v));
    }
    return fraction;
}
