#include "exponential.h"

#define SERIES_RADIUS 0.5f /* within it, eight terms leave less than float32 can hold */
#define HALVINGS_MAX 12    /* for |z| up to 2000, where anything a plate does within a tick has long ended */

static const float INVERSE_FACTORIAL[] = {1.0f / 2, 1.0f / 6, 1.0f / 24, 1.0f / 120, 1.0f / 720, 1.0f / 5040,
                                          1.0f / 40320, 1.0f / 362880};

static hd_phasor_t one_plus(hd_phasor_t z)
{
    return (hd_phasor_t){1.0f + z.d, z.q};
}

/* phi2 by Horner; the other two follow by products, and lose nothing where z is small. */
static hd_exponential_t series(hd_phasor_t z)
{
    int n = sizeof INVERSE_FACTORIAL / sizeof *INVERSE_FACTORIAL;
    hd_phasor_t phi2 = {INVERSE_FACTORIAL[n - 1], 0.0f};
    for (int i = n - 2; i >= 0; i--) {
        phi2 = hd_mul(z, phi2);
        phi2.d += INVERSE_FACTORIAL[i];
    }
    hd_phasor_t phi1 = one_plus(hd_mul(z, phi2));
    return (hd_exponential_t){one_plus(hd_mul(z, phi1)), phi1, phi2};
}

static hd_exponential_t doubled(hd_exponential_t of)
{
    hd_phasor_t phi2 = hd_add(hd_scale(0.25f, hd_mul(of.phi1, of.phi1)), hd_scale(0.5f, of.phi2));
    hd_phasor_t phi1 = hd_scale(0.5f, hd_mul(of.phi1, one_plus(of.exp)));
    return (hd_exponential_t){hd_mul(of.exp, of.exp), phi1, phi2};
}

hd_exponential_t hd_exponential(hd_phasor_t z)
{
    int halvings = 0;
    while (halvings < HALVINGS_MAX && hd_magnitude(z) > SERIES_RADIUS) {
        z = hd_scale(0.5f, z);
        halvings++;
    }
    hd_exponential_t of = series(z);
    for (int i = 0; i < halvings; i++) {
        of = doubled(of);
    }
    return of;
}

float hd_decay(float x)
{
    return hd_exponential((hd_phasor_t){x, 0.0f}).exp.d;
}
