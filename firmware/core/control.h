/* The vibration amplitude controller: per mode of the rotating frame, after Ghenna et al. (the founding paper, eq. 5-6,
 * figure 5): V_q drives W_d, -V_d drives W_q.
 *
 *   plate            dW/dt = (-sigma + j delta) W - j g V          u = -j V, so that u drives W in phase
 *   HD_LAW_PI        u = kp e + ki integral(e),  e = r - W         the paper's four independent controllers
 *   HD_LAW_PI_FF     the same on e = x - W, plus (x' + (sigma - j delta) x) / g and (j delta / g) e
 *   HD_LAW_DEADBEAT  u such that W will be x' + p (W^ - x), for W^ and the disturbance estimated by an observer
 *
 * x is the reference made feasible: it moves straight towards the reference amplitudes, all modes by the same fraction, as
 * fast as the amplifiers can drive the plate. So a step keeps the node under a still finger where it is. PI_FF knows
 * the nominal plate only and leaves the rest to its integrals; DEADBEAT plans with the disturbance as observed, holds
 * no integral of an error, and so has nothing to wind up when the voltage saturates.
 */
#ifndef HD_CONTROL_H
#define HD_CONTROL_H

#include <stdbool.h>
#include <stdint.h>

#include "observer.h"
#include "phasor.h"
#include "plant.h"
#include "protocol.h"
#include "reach.h"

/* A mode's decay and detuning as learned from its vibration; the model's own values while nothing better is known. */
typedef struct {
    float decay_1_s;
    float detuning_rad_s;
} hd_estimate_t;

typedef struct {
    uint8_t law;           /* enum hd_law */
    float bandwidth_1_s;   /* PI: kp = bandwidth / g, the same loop for every mode. DEADBEAT: p = e^(-bandwidth T) */
    float integral_time_s; /* PI: ki = kp / integral time. DEADBEAT: in which the observer follows a disturbance */
} hd_gains_t;

typedef struct {
    hd_phasor_t x_um[3];    /* at the end of the coming hold, at its beginning, and one tick earlier */
    hd_phasor_t integral_v;
    hd_phasor_t coupling_v_per_um[HD_MODES]; /* what each mode does to this one, its own change among it (coupling.h) */
    hd_observer_t observer; /* watches under every law, so that the estimates do not depend on it */
} hd_loop_t;

/* Plant and gains, and all that can be computed from them once and for all. */
typedef struct {
    hd_plant_t plant;
    hd_gains_t gains;
    float pole;            /* p of DEADBEAT */
    float integral_frac;   /* ki / kp of a tick */
    float ticks_per_s;
    uint32_t lookahead_us; /* lead of the law's reference before the tick: the end of the voltage hold */
    float shown_um_per_v[HD_MODES]; /* what a volt of a mode that is held shows at least, by sensor (plausibility.c) */
    float doubt_um_per_v[HD_MODES]; /* of the feedthrough: what a volt may add to its mode's measurement all the same */
    float coupling_memory_frac; /* of the couplings' least squares, that a tick leaves */
    hd_wires_t wires;
    hd_observer_design_t observer[HD_MODES];
    hd_reach_design_t reach[HD_MODES];
    uint32_t balance; /* brings the sum of its words to 0 (memory.h) */
} hd_design_t;

typedef struct {
    hd_design_t design;
    hd_loop_t loop[HD_MODES];
    float coupling_um2;      /* sum of |W|^2 that the couplings were learned from */
    bool probes;             /* adds to what a law asks of the modes, so that their sensors have something to show (reach.h): */
    float probe_v[HD_MODES];
    float probe_frac;        /* of the voltage limit, that they take from the law; 0 without */
    uint8_t turn;            /* the mode and sensor that this tick judges */
} hd_control_t;

/* Gains of 0 stand for those that this firmware was tested with at such ticks; everything else is taken as it is. */
hd_gains_t hd_gains_complete(hd_gains_t gains, float tick_s);
bool hd_gains_valid(const hd_gains_t *gains);

/* Completes a design whose plant and gains are given. It takes as long as two ticks: nothing that runs should wait for
 * it, and nothing need. */
void hd_control_design(hd_design_t *design);

/* Whether the loop that this design makes with its own plate comes to rest from a small amplitude. */
bool hd_control_stable(const hd_design_t *design);

/* At rest, by this design. What was learned of a mode is kept unless its model is another. */
void hd_control_adopt(hd_control_t *control, const hd_design_t *design);

/* Forgets integrals and trajectories: the next step starts from rest. */
void hd_control_reset(hd_control_t *control);

hd_estimate_t hd_control_estimate(const hd_control_t *control, int mode);

/* The share of this amplitude that the amplifiers hold in one mode alone, of the plate as it has turned out to be. */
float hd_control_holdable(const hd_control_t *control, int mode, float w_um, float v_limit_v);

/* One tick. Writes the amplifiers' voltages, each |V_k| <= v_limit_v; true if the voltage limit keeps the plate from
 * following. */
bool hd_control_step(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
                     const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t voltage_v[HD_MODES]);

#endif
