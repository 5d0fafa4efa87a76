/* The vibration amplitude controller: per mode and axis of the rotating frame a PI, after Ghenna et al. (the founding
 * paper, eq. 5-6, figure 5): V_q drives W_d, -V_d drives W_q.
 *
 *   plate          dW/dt = (-sigma + j delta) W - j g V          u = -j V, so that u drives W in phase
 *   HD_LAW_PI      u = kp e + ki integral(e),  e = r - W         the paper's four independent controllers
 *   HD_LAW_PI_FF   the same on e = x - W, plus (x' + (sigma - j delta) x) / g and (j delta / g) e
 *
 * x is the reference made feasible: it moves straight towards the asked amplitudes, all modes by the same fraction, as
 * fast as the amplifiers can drive the nominal plate. So a step keeps the node under a still finger where it is, and
 * the feedback has only to correct what the model does not know. The error compares like with like: the measurement is
 * a mean over the tick just ended, so it is subtracted from the mean of x over the same time.
 */
#ifndef HD_CONTROL_H
#define HD_CONTROL_H

#include <stdbool.h>
#include <stdint.h>

#include "phasor.h"
#include "protocol.h"

/* One mode of the plate as the board believes it to be. */
typedef struct {
    float decay_1_s;
    float detuning_rad_s;
    float gain_um_per_v_s;
    hd_phasor_t loop; /* unit phasor of the loop's constant phase: what goes out is turned back by it; (1, 0) for none */
} hd_mode_model_t;

/* What the observer has learned of a mode from holding it; the model's own values while it knows nothing better. */
typedef struct {
    float decay_1_s;
    float detuning_rad_s;
} hd_estimate_t;

typedef struct {
    uint8_t law;           /* enum hd_law */
    float bandwidth_1_s;   /* kp = bandwidth / g: the same loop for every mode */
    float integral_time_s; /* ki = kp / integral time */
} hd_gains_t;

typedef struct {
    hd_mode_model_t model[HD_MODES];
    float tick_s;
    float output_delay_frac; /* of a tick, from the call to the voltage on the plate */
} hd_plant_t;

typedef struct {
    hd_phasor_t x_um[3];    /* at the end of the coming hold, at its beginning, and one tick earlier */
    hd_phasor_t integral_v;
} hd_loop_t;

typedef struct {
    hd_plant_t plant;
    hd_gains_t gains;
    hd_loop_t loop[HD_MODES];
} hd_control_t;

/* Gains of 0 stand for those that this firmware was tested with; everything else is taken as it is. */
hd_gains_t hd_gains_complete(hd_gains_t gains);
bool hd_gains_valid(const hd_gains_t *gains);

/* Forgets integrals and trajectories: the next step starts from rest. */
void hd_control_reset(hd_control_t *control);

/* How far ahead of the tick the law wants its reference: the end of the voltage hold, or nothing for the paper's. */
float hd_control_lookahead_s(const hd_control_t *control);

hd_estimate_t hd_control_estimate(const hd_control_t *control, int mode);

/* One tick. Writes the voltages, each |V_k| <= v_limit_v; true if the plate cannot follow for want of voltage. */
bool hd_control_step(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
                     const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t voltage_v[HD_MODES]);

#endif
