/* The board's limits, independent of the host's: on reference amplitudes and output voltages. */
#ifndef HD_LIMITER_H
#define HD_LIMITER_H

#include <stdbool.h>

#include "phasor.h"
#include "protocol.h"

#define HD_LIMIT_TOLERANCE 1e-6f /* rounding by float32 of a reference limited by the host */

typedef enum {
    HD_LIMIT_UNTOUCHED,
    HD_LIMIT_SCALED,
    HD_LIMIT_NOT_FINITE,
} hd_limit_t;

/* Brings every |W_k| within its limit by one common factor, so that the pattern on the plate, and the node under a
 * still finger, survive. Modal amplitudes that are not finite become zero. */
hd_limit_t hd_limit_amplitudes(hd_phasor_t modal_um[HD_MODES], const float limit_um[HD_MODES]);

/* The phasor of the same phase whose magnitude is `limit`, a little less after rounding. */
hd_phasor_t hd_shorten(hd_phasor_t value, float limit);

/* The phasor of the same phase whose magnitude is at most `limit`. Non-finite values stay so, for the gate to detect. */
static inline hd_phasor_t hd_limit_magnitude(hd_phasor_t value, float limit)
{
    return hd_within(value, limit) ? value : hd_shorten(value, limit);
}

/* The final gate of the voltages: each mode within `limit_v`, all zero if any is not finite. */
hd_limit_t hd_limit_voltages(hd_phasor_t voltage_v[HD_MODES], float limit_v);

#endif
