#include "control.h"

#include <string.h>

#include "limiter.h"

/* Share of the voltage withheld by the clamp that leaves the integral at each tick (back-calculation). */
#define ANTI_WINDUP_FRAC 0.3f

/* Share of the voltage that may go into holding an amplitude. Without the rest a mode at its limit could not move at
 * all, and because all modes move by one fraction it would hold up the others. */
#define HOLDABLE_FRAC 0.97f

/* Found on the simulated plate over Q 200..1000, damping x0.5..x1.5 and detuning +-20 Hz: the paper's law settles in
 * the paper's 10 ms at Q 500; the other has 39 degrees of phase margin or more, counting a delay of 1.2 ticks in the
 * loop. */
static const hd_gains_t TESTED_PI = {HD_LAW_PI, 750.0f, 0.005f};
static const hd_gains_t TESTED_PI_FF = {HD_LAW_PI_FF, 900.0f, 0.0025f};

hd_gains_t hd_gains_complete(hd_gains_t gains)
{
    const hd_gains_t *tested = gains.law == HD_LAW_PI ? &TESTED_PI : &TESTED_PI_FF;
    if (gains.bandwidth_1_s == 0.0f) {
        gains.bandwidth_1_s = tested->bandwidth_1_s;
    }
    if (gains.integral_time_s == 0.0f) {
        gains.integral_time_s = tested->integral_time_s;
    }
    return gains;
}

bool hd_gains_valid(const hd_gains_t *gains)
{
    return (gains->law == HD_LAW_PI || gains->law == HD_LAW_PI_FF)
        && gains->bandwidth_1_s >= HD_BANDWIDTH_MIN_1_S && gains->bandwidth_1_s <= HD_BANDWIDTH_MAX_1_S
        && gains->integral_time_s >= HD_INTEGRAL_TIME_MIN_S && gains->integral_time_s <= HD_INTEGRAL_TIME_MAX_S;
}

void hd_control_reset(hd_control_t *control)
{
    memset(control->loop, 0, sizeof control->loop);
}

float hd_control_lookahead_s(const hd_control_t *control)
{
    const hd_plant_t *plant = &control->plant;
    return control->gains.law == HD_LAW_PI_FF ? (1.0f + plant->output_delay_frac) * plant->tick_s : 0.0f;
}

hd_estimate_t hd_control_estimate(const hd_control_t *control, int mode)
{
    const hd_mode_model_t *model = &control->plant.model[mode];
    return (hd_estimate_t){model->decay_1_s, model->detuning_rad_s};
}

/* What an amplitude costs to hold: (sigma - j delta) W = g u. */
static hd_phasor_t holding_demand(const hd_mode_model_t *model, hd_phasor_t w_um)
{
    return hd_mul((hd_phasor_t){model->decay_1_s, -model->detuning_rad_s}, w_um);
}

/* u over the coming hold that takes the nominal mode from x to x + step along a straight line. */
static hd_phasor_t feed_forward_v(const hd_mode_model_t *model, float tick_s, hd_phasor_t x_um, hd_phasor_t step_um)
{
    hd_phasor_t slope = hd_scale(1.0f / tick_s, step_um);
    hd_phasor_t middle_um = hd_add(x_um, hd_scale(0.5f, step_um));
    return hd_scale(1.0f / model->gain_um_per_v_s, hd_add(slope, holding_demand(model, middle_um)));
}

/* Largest fraction f in [0, 1] with |hold + f move| <= limit, where |hold| < limit. */
static float feasible_fraction(hd_phasor_t hold, hd_phasor_t move, float limit)
{
    float a = hd_dot(move, move), b = hd_dot(hold, move), c = hd_dot(hold, hold) - limit * limit;
    if (!(a + 2.0f * b + c > 0.0f)) {
        return 1.0f;
    }
    float root = sqrtf(b * b - a * c);
    float f = b > 0.0f ? -c / (b + root) : (root - b) / a; /* no difference of near equals in either */
    return fminf(fmaxf(f, 0.0f), 1.0f);
}

/* Factor that brings every reference to where the amplifiers can hold the nominal plate. One factor for all modes: less
 * amplitude everywhere, but the node under a still finger stays where it is. */
static float holdable_fraction(const hd_control_t *control, const hd_phasor_t reference_um[HD_MODES], float v_limit_v)
{
    float fraction = 1.0f;
    for (int k = 0; k < HD_MODES; k++) {
        const hd_mode_model_t *model = &control->plant.model[k];
        float demand_v = hd_magnitude(holding_demand(model, reference_um[k])) / model->gain_um_per_v_s;
        if (demand_v > HOLDABLE_FRAC * v_limit_v) {
            fraction = fminf(fraction, HOLDABLE_FRAC * v_limit_v / demand_v);
        }
    }
    return fraction;
}

/* Moves every trajectory by the same fraction of its way to the reference. Returns what is left of the reference. */
static float advance_trajectories(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES], float v_limit_v)
{
    float tick_s = control->plant.tick_s;
    float holdable = holdable_fraction(control, reference_um, v_limit_v);
    hd_phasor_t goal_um[HD_MODES];
    float fraction = 1.0f;
    for (int k = 0; k < HD_MODES; k++) {
        const hd_mode_model_t *model = &control->plant.model[k];
        hd_phasor_t x_um = control->loop[k].x_um[0];
        goal_um[k] = hd_scale(holdable, reference_um[k]);
        hd_phasor_t hold_v = feed_forward_v(model, tick_s, x_um, (hd_phasor_t){0.0f, 0.0f});
        hd_phasor_t all_v = feed_forward_v(model, tick_s, x_um, hd_sub(goal_um[k], x_um));
        /* A falling limit, on the ramp to silence, may leave a trajectory above it: it must get away from there. */
        float budget_v = fmaxf(v_limit_v, hd_magnitude(hold_v) + (1.0f - HOLDABLE_FRAC) * v_limit_v);
        fraction = fminf(fraction, feasible_fraction(hold_v, hd_sub(all_v, hold_v), budget_v));
    }
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t *x_um = control->loop[k].x_um;
        x_um[2] = x_um[1];
        x_um[1] = x_um[0];
        hd_phasor_t way_um = hd_sub(goal_um[k], x_um[0]);
        x_um[0] = fraction == 1.0f ? goal_um[k] : hd_add(x_um[0], hd_scale(fraction, way_um));
    }
    return fminf(fraction, holdable);
}

/* Mean of the trajectory over the tick just ended. Its corners lie `delay` after the ticks, so three of them matter. */
static hd_phasor_t trajectory_mean(const hd_phasor_t x_um[3], float delay_frac)
{
    float newest = 0.5f * (1.0f - delay_frac) * (1.0f - delay_frac);
    float oldest = 0.5f * delay_frac * delay_frac;
    hd_phasor_t ends = hd_add(hd_scale(newest, x_um[0]), hd_scale(oldest, x_um[2]));
    return hd_add(ends, hd_scale(1.0f - newest - oldest, x_um[1]));
}

/* PI on the error with back-calculation. Returns V = j u for u within the limit. */
static hd_phasor_t drive_mode(hd_control_t *control, int k, hd_phasor_t error_um, hd_phasor_t ahead_v,
                              float v_limit_v, bool *saturated)
{
    const hd_mode_model_t *model = &control->plant.model[k];
    const hd_gains_t *gains = &control->gains;
    hd_phasor_t *integral_v = &control->loop[k].integral_v;
    float coupling_rad_s = gains->law == HD_LAW_PI_FF ? model->detuning_rad_s : 0.0f;
    hd_phasor_t kp = hd_scale(1.0f / model->gain_um_per_v_s, (hd_phasor_t){gains->bandwidth_1_s, coupling_rad_s});
    float ki_tick = gains->bandwidth_1_s / model->gain_um_per_v_s * control->plant.tick_s / gains->integral_time_s;

    hd_phasor_t wanted_v = hd_add(ahead_v, hd_add(hd_mul(kp, error_um), *integral_v));
    hd_phasor_t u_v = hd_limit_magnitude(wanted_v, v_limit_v);
    hd_phasor_t withheld_v = hd_sub(wanted_v, u_v);
    hd_phasor_t gained_v = hd_sub(hd_scale(ki_tick, error_um), hd_scale(ANTI_WINDUP_FRAC, withheld_v));
    *integral_v = hd_add(*integral_v, gained_v);
    *saturated |= withheld_v.d != 0.0f || withheld_v.q != 0.0f;
    return (hd_phasor_t){-u_v.q, u_v.d};
}

static bool step_pi(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
                    const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t voltage_v[HD_MODES])
{
    bool saturated = false;
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t error_um = hd_sub(reference_um[k], measured_um[k]);
        voltage_v[k] = drive_mode(control, k, error_um, (hd_phasor_t){0.0f, 0.0f}, v_limit_v, &saturated);
    }
    return saturated;
}

static bool step_pi_ff(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
                       const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t voltage_v[HD_MODES])
{
    const hd_plant_t *plant = &control->plant;
    hd_phasor_t error_um[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        error_um[k] = hd_sub(trajectory_mean(control->loop[k].x_um, plant->output_delay_frac), measured_um[k]);
    }
    bool saturated = advance_trajectories(control, reference_um, v_limit_v) < 1.0f;
    for (int k = 0; k < HD_MODES; k++) {
        const hd_phasor_t *x_um = control->loop[k].x_um;
        hd_phasor_t ahead_v = feed_forward_v(&plant->model[k], plant->tick_s, x_um[1], hd_sub(x_um[0], x_um[1]));
        voltage_v[k] = drive_mode(control, k, error_um[k], ahead_v, v_limit_v, &saturated);
    }
    return saturated;
}

bool hd_control_step(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
                     const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t voltage_v[HD_MODES])
{
    return control->gains.law == HD_LAW_PI_FF
        ? step_pi_ff(control, reference_um, measured_um, v_limit_v, voltage_v)
        : step_pi(control, reference_um, measured_um, v_limit_v, voltage_v);
}
