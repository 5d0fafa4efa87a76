/* How far the plate may have gone, from the voltage alone, unless its sensors prove to show what the voltage does.
 *
 *   R' = -LEAST_DAMPING decay R + gain |u|      |W| <= R, whatever the resonance, the fingers and the sensors say
 *
 * A sensor is trusted for a while once the observer has foreseen what changes of the voltage showed. With the filter that
 * makes the observer's innovations i out of what a sensor shows, E, of the observer's poles p1 and p2,
 *
 *   v = e u + (b - e) u_old      e, b: what a volt adds to the mean over a tick, and over the next
 *   E = v - v_old + (p1 + p2) E_old - p1 p2 E_older
 *
 * a sensor that shows a share s of it leaves i = -(1 - s) E. So it is trusted if sum |i|^2 <= MISSED^2 sum |E|^2 over the
 * last milliseconds. No noise, hum, neighbour or feedthrough does that, nor a voltage that answers them, nor a part of the
 * signal; a plate that fingers or a drift have changed still does, because the observer learns what they do, and E
 * is what changes faster. While the sensors that a mode is measured by are trusted, what they read bounds R. While they
 * are not and R is large, the modes' drives get small random steps, so that a sound sensor has something to show;
 * near REACH times the mode's limit the voltage is limited to what keeps R there.
 *
 * Not seen: a share of MISSED that a signal lost; a gain above the model's, or a damping below LEAST_DAMPING of it.
 */
#ifndef HD_REACH_H
#define HD_REACH_H

#include <stdint.h>

#include "observer.h"

#define HD_LEAST_UM 0.01f     /* that must have been expected, RMS over the sums: converters show a tenth of it */

typedef struct {
    float kept;            /* of R, over a tick */
    float push_um_per_v;   /* b */
    float newest_um_per_v; /* e */
    float v_per_um;        /* of amplifiers that all drive the mode at once, by what they add in a tick */
    float change_v;        /* of the voltage, that a sensor surely shows */
    uint32_t sensors;      /* those that count in the mode's measurement, one bit each */
} hd_reach_design_t;

/* Of mode and sensor k. */
typedef struct {
    float reach_um;                 /* R when the last voltage ends */
    hd_phasor_t shown_um;           /* v_old; it and E only while a change of the voltage is being followed */
    hd_phasor_t expected_um[2];     /* E_old, E_older */
    float missed_um2, expected_um2; /* recent sums of |i|^2, and of |E|^2 while the sensor is due */
    float contrary_um, contrary_um2; /* recent sum of what a sensor showed against the probes, and of its squares */
    uint16_t trusted_turns;         /* for which the sensor is still trusted */
    uint8_t answers;                /* that these sums are of */
    uint8_t settling_turns;         /* until its sums begin */
} hd_reach_t;

/* By mode `k`'s observer; what its amplifiers do to it is `back`, what its sensors count in it `sense`. */
void hd_reach_design(hd_reach_design_t *design, const hd_observer_design_t *mode, const hd_phasor_t back[HD_MODES],
                     const hd_phasor_t sense[HD_MODES], float tick_s);

#endif
