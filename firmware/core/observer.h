/* Estimates a mode's state and the disturbance on it from its measured means.
 *
 *   W' = a W + b (u + d)                        between instants at which the voltage changes, exact while it is held
 *   y  = c W + e0 u + e1 u_old + (e0 + e1) d    the mean over a tick, which sees two voltages
 *
 * d is the disturbance in volts: fingers, drift, other modes. Both are corrected by the innovation, with gains that put
 * the poles of the error at e^(-2 bandwidth T) and e^(-T / integral time).
 *
 * A finger or a drift shows as d = (change of decay and detuning) W / g. Least squares of d on W, with exponential
 * forgetting, estimate that change, in volts per um, which predicts the voltage to hold an amplitude; the host reads it.
 * What other modes feed in counts as this mode's own as far as it moves with it (coupling.c separates them).
 */
#ifndef HD_OBSERVER_H
#define HD_OBSERVER_H

#include "plant.h"

typedef struct {
    hd_mode_model_t model;
    float v_per_um_s;                 /* 1 / g */
    hd_phasor_t keep;                 /* a */
    hd_phasor_t push_um_per_v;        /* b */
    hd_phasor_t push_v_per_um;        /* 1 / b */
    hd_phasor_t holding_v_per_um;     /* u that holds an amplitude on the plate of the model */
    float surprise_um_per_v, hurry_v2_per_um2; /* what a swing is judged by (plausibility.c) */
    float least_taken_1_s; /* power per |W|^2 that its damping takes, and phases may not hide (plausibility.c) */
    hd_phasor_t mean_of_state;        /* c */
    hd_phasor_t mean_of_new_um_per_v; /* e0: the voltage that holds for most of the tick */
    hd_phasor_t mean_of_old_um_per_v; /* e1: the one before, until the new one is out */
    float old_frac; /* of a tick, for which the voltage before is still out */
    hd_phasor_t state_gain;
    hd_phasor_t disturbance_gain_v_per_um;
    float poles_sum, poles_product; /* of the error's two poles: what reach.h expects innovations by */
    float newest_v_per_um; /* times an innovation: what of it is likely to be d (coupling.c) */
    float absurd_v2_per_um2; /* the square of a disturbance per amplitude that no finger causes */
    float memory_frac; /* of the least squares, that one step leaves: a mode learns when its turn comes */
    float change_limit_v_per_um;
} hd_observer_design_t;

typedef struct {
    hd_phasor_t before_um; /* when the voltage of the last call took over, corrected */
    hd_phasor_t w_um;      /* when the voltage of the coming call takes over */
    hd_phasor_t disturbance_v;
    hd_phasor_t new_v, old_v; /* u of the last call, and of the one before */
    hd_phasor_t innovation_um; /* of the last tick */
    hd_phasor_t taken_um_v;    /* sums of conj(W) u, u the mean over a tick, and |W|^2 as measured, since they were last judged */
    float w_um2;

    hd_phasor_t moment_v_um; /* sum of conj(W) d */
    float power_um2;         /* sum of |W|^2; 0 while nothing is known */
    uint32_t learned_turns;  /* since the drive was last moved after the plate */
    hd_phasor_t change_v_per_um; /* d per W: of -decay + j detuning, up to a quarter per tick, by g; 0 while not known */
} hd_observer_t;

/* For this model and these rates. As long as two ticks: not for the tick itself. */
void hd_observer_design(hd_observer_design_t *design, const hd_mode_model_t *model, float tick_s,
                        float output_delay_frac, float bandwidth_1_s, float integral_time_s);

/* At rest; what was learned is kept. */
void hd_observer_rest(hd_observer_t *observer);

/* Takes the mean over the tick just ended and moves the state on to where the next voltage takes over. */
void hd_observer_correct(hd_observer_t *observer, const hd_observer_design_t *design, hd_phasor_t measured_um);

/* Learns from the corrected state; by how much that moved what is known. */
hd_phasor_t hd_observer_learn(hd_observer_t *observer, const hd_observer_design_t *design);

/* Tells what the mode will be driven with: the voltage as limited, so that a limit is never taken for a disturbance. */
static inline void hd_observer_drive(hd_observer_t *observer, hd_phasor_t u_v)
{
    observer->old_v = observer->new_v;
    observer->new_v = u_v;
}

/* The drive is faster by so much from now on: what was learned is of another frame. */
static inline void hd_observer_turn(hd_observer_t *observer, const hd_observer_design_t *design, float faster_rad_s)
{
    float faster_v_per_um = design->v_per_um_s * faster_rad_s;
    observer->change_v_per_um.q -= faster_v_per_um;
    observer->moment_v_um.q -= faster_v_per_um * observer->power_um2;
}

/* u that holds an amplitude on the plate as learned. */
static inline hd_phasor_t hd_observer_holding_v(const hd_observer_t *observer, const hd_observer_design_t *design,
                                                hd_phasor_t w_um)
{
    return hd_mul(hd_sub(design->holding_v_per_um, observer->change_v_per_um), w_um);
}

#endif
