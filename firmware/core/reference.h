/* The reference in time: polylines of modal amplitudes, each valid from its first knot until the next one's.
 *
 * The host plans ahead, so a frame usually comes while the one before it is still running, or has not even begun: a
 * short queue ordered by start time keeps them apart. A newer frame replaces every queued one that would start at its
 * own start or later. After the last knot its value is held.
 */
#ifndef HD_REFERENCE_H
#define HD_REFERENCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "phasor.h"
#include "protocol.h"

#define HD_POLYLINES 8 /* one running, seven waiting: a horizon of 14 ms at 500 frames a second */

/* True if instant `a` comes before `b` on a clock that wraps, for instants less than 35 minutes apart. */
static inline bool hd_before(uint32_t a_us, uint32_t b_us)
{
    return (int32_t)(a_us - b_us) < 0;
}

typedef struct {
    uint32_t offset_us; /* since the start of its polyline; the first is 0 */
    hd_phasor_t modal_um[HD_MODES];
} hd_knot_t;

typedef struct {
    uint32_t t_start_us; /* the instant of its first knot */
    uint32_t t_received_us;
    uint16_t seq;
    bool limited;      /* the board had to scale a knot */
    bool pulse;        /* its start is shown by the sync output */
    bool acknowledged; /* its start has been reported */
    uint8_t n;
    hd_knot_t knot[HD_KNOTS_MAX];
} hd_polyline_t;

typedef struct {
    hd_polyline_t polyline[HD_POLYLINES];
    uint8_t first; /* the running one, once `running` */
    uint8_t count;
    uint8_t segment; /* knot that the last evaluation had passed; past the last one, times that wrap count no longer */
    bool running;
} hd_timeline_t;

void hd_timeline_clear(hd_timeline_t *timeline);

/* The slot for a new polyline: the caller fills all of it. Its `pulse` is set if it replaces one that has it. */
hd_polyline_t *hd_timeline_open(hd_timeline_t *timeline, uint32_t t_start_us);

/* The modal amplitudes of the reference at t_us, zero before the first polyline. Instants must not decrease. */
void hd_timeline_evaluate(hd_timeline_t *timeline, uint32_t t_us, hd_phasor_t modal_um[HD_MODES]);

/* The active polyline at the last evaluation, or NULL. */
static inline hd_polyline_t *hd_timeline_running(hd_timeline_t *timeline)
{
    return timeline->running ? &timeline->polyline[timeline->first] : NULL;
}

#endif
