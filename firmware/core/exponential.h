/* e^z and its two divided differences at 0, for complex z in float32: what a linear system does in a given time.
 *
 * Without the C library's functions, which differ between newlib and glibc in their last bits.
 */
#ifndef HD_EXPONENTIAL_H
#define HD_EXPONENTIAL_H

#include "phasor.h"

typedef struct {
    hd_phasor_t exp;  /* e^z */
    hd_phasor_t phi1; /* (e^z - 1) / z, 1 at 0 */
    hd_phasor_t phi2; /* (phi1 - 1) / z, 1/2 at 0 */
} hd_exponential_t;

/* To 1e-6 of their size for |z| < 4 (tests/firmware/test_observer.py compares them with mpmath). */
hd_exponential_t hd_exponential(hd_phasor_t z);

/* e^x for x <= 0. */
float hd_decay(float x);

#endif
