/* How far the modes may go towards their goals within the voltage: all of them by one common fraction, so that the node
 * under a still finger stays where it is while they move. */
#ifndef HD_GOVERNOR_H
#define HD_GOVERNOR_H

#include "wiring.h"

/* Factor that brings what all modes need to be held within what the amplifiers can hold for long. */
float hd_holdable_fraction(const hd_wires_t *wires, const hd_phasor_t holding_v[HD_MODES], float v_limit_v);

/* Largest fraction f in [0, 1] with which stay_v + f move_v leaves every amplifier within the limit. */
float hd_feasible_fraction(const hd_wires_t *wires, const hd_phasor_t stay_v[HD_MODES],
                           const hd_phasor_t move_v[HD_MODES], float v_limit_v);

/* The point at this fraction of the way; the goal itself at 1. */
static inline hd_phasor_t hd_on_the_way(hd_phasor_t from, hd_phasor_t to, float fraction)
{
    return fraction == 1.0f ? to : hd_add(from, hd_scale(fraction, hd_sub(to, from)));
}

#endif
