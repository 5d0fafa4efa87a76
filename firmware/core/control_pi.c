#include <string.h>

#include "control_laws.h"
#include "governor.h"

/* Share of the voltage withheld by the clamp that leaves the integral at each tick (back-calculation). */
#define ANTI_WINDUP_FRAC 0.3f

/* u by PI and feed-forward. */
static hd_phasor_t target_v(const hd_control_t *control, int k, hd_phasor_t error_um, hd_phasor_t ahead_v)
{
    const hd_observer_design_t *design = &control->design.observer[k];
    const hd_gains_t *gains = &control->design.gains;
    float coupling_rad_s = gains->law == HD_LAW_PI_FF ? design->model.detuning_rad_s : 0.0f;
    hd_phasor_t kp = hd_scale(design->v_per_um_s, (hd_phasor_t){gains->bandwidth_1_s, coupling_rad_s});
    return hd_add(ahead_v, hd_add(hd_mul(kp, error_um), control->loop[k].integral_v));
}

/* PI on the error with back-calculation; the clamp keeps each amplifier's phase. */
static bool drive_modes(hd_control_t *control, const hd_phasor_t error_um[HD_MODES],
                        const hd_phasor_t ahead_v[HD_MODES], float v_limit_v, hd_phasor_t u_v[HD_MODES],
                        hd_phasor_t voltage_v[HD_MODES])
{
    hd_phasor_t targets_v[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        targets_v[k] = target_v(control, k, error_um[k], ahead_v[k]);
    }
    memcpy(u_v, targets_v, sizeof targets_v);
    bool reduced = hd_wiring_drive(&control->design.wires, u_v, v_limit_v, voltage_v);
    for (int k = 0; k < HD_MODES; k++) {
        const hd_design_t *design = &control->design;
        float ki_tick = design->observer[k].v_per_um_s * design->gains.bandwidth_1_s * design->integral_frac;
        hd_phasor_t withheld_v = hd_scale(ANTI_WINDUP_FRAC, hd_sub(targets_v[k], u_v[k]));
        hd_phasor_t gained_v = hd_sub(hd_scale(ki_tick, error_um[k]), withheld_v);
        control->loop[k].integral_v = hd_add(control->loop[k].integral_v, gained_v);
    }
    return reduced;
}

bool hd_law_pi(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
               const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t u_v[HD_MODES],
               hd_phasor_t voltage_v[HD_MODES])
{
    static const hd_phasor_t none_v[HD_MODES];
    hd_phasor_t error_um[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        error_um[k] = hd_sub(reference_um[k], measured_um[k]);
    }
    return drive_modes(control, error_um, none_v, v_limit_v, u_v, voltage_v);
}

/* What an amplitude costs to hold on the nominal plate: (sigma - j delta) W = g u. */
static hd_phasor_t holding_v(const hd_observer_design_t *design, hd_phasor_t w_um)
{
    return hd_mul(design->holding_v_per_um, w_um);
}

/* u over the coming hold that takes the nominal mode from x to x + step along a straight line. */
static hd_phasor_t feed_forward_v(const hd_design_t *design, int k, hd_phasor_t x_um, hd_phasor_t step_um)
{
    const hd_observer_design_t *mode = &design->observer[k];
    hd_phasor_t slope_v = hd_scale(design->ticks_per_s * mode->v_per_um_s, step_um);
    return hd_add(slope_v, holding_v(mode, hd_add(x_um, hd_scale(0.5f, step_um))));
}

/* Moves every trajectory by the same fraction of its way to the reference. Returns what is left of the reference. */
static float advance_trajectories(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES], float v_limit_v)
{
    const hd_design_t *design = &control->design;
    hd_phasor_t goal_um[HD_MODES], goal_v[HD_MODES], stay_v[HD_MODES], move_v[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        goal_v[k] = holding_v(&design->observer[k], reference_um[k]);
    }
    float holdable = hd_holdable_fraction(&design->wires, goal_v, v_limit_v);
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t x_um = control->loop[k].x_um[0];
        goal_um[k] = hd_scale(holdable, reference_um[k]);
        stay_v[k] = holding_v(&design->observer[k], x_um);
        move_v[k] = hd_sub(feed_forward_v(design, k, x_um, hd_sub(goal_um[k], x_um)), stay_v[k]);
    }
    float fraction = hd_feasible_fraction(&design->wires, stay_v, move_v, v_limit_v);
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t *x_um = control->loop[k].x_um;
        x_um[2] = x_um[1];
        x_um[1] = x_um[0];
        x_um[0] = hd_on_the_way(x_um[1], goal_um[k], fraction);
    }
    return hd_smaller(fraction, holdable);
}

/* Mean of the trajectory over the tick just ended. Its corners lie `delay` after the ticks, so three of them matter. */
static hd_phasor_t trajectory_mean(const hd_phasor_t x_um[3], float delay_frac)
{
    float newest = 0.5f * (1.0f - delay_frac) * (1.0f - delay_frac);
    float oldest = 0.5f * delay_frac * delay_frac;
    hd_phasor_t ends = hd_add(hd_scale(newest, x_um[0]), hd_scale(oldest, x_um[2]));
    return hd_add(ends, hd_scale(1.0f - newest - oldest, x_um[1]));
}

/* The error compares like with like: the measurement is a mean over the tick just ended, so it is subtracted from the
 * mean of x over the same time. */
bool hd_law_pi_ff(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
                  const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t u_v[HD_MODES],
                  hd_phasor_t voltage_v[HD_MODES])
{
    const hd_design_t *design = &control->design;
    hd_phasor_t error_um[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        error_um[k] = hd_sub(trajectory_mean(control->loop[k].x_um, design->plant.output_delay_frac), measured_um[k]);
    }
    bool saturated = advance_trajectories(control, reference_um, v_limit_v) < 1.0f;
    hd_phasor_t ahead_v[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        const hd_phasor_t *x_um = control->loop[k].x_um;
        ahead_v[k] = feed_forward_v(design, k, x_um[1], hd_sub(x_um[0], x_um[1]));
    }
    return drive_modes(control, error_um, ahead_v, v_limit_v, u_v, voltage_v) || saturated;
}
