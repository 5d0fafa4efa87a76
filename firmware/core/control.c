#include "control.h"

#include "control_laws.h"
#include "coupling.h"
#include "exponential.h"
#include "governor.h"
#include "memory.h"

/* Found on the simulated plate over Q 200..1000, damping x0.5..x1.5 and detuning +-20 Hz (`hapticd bench firmware`).
 * The paper's law settles in the paper's 10 ms at Q 500. The second has 39 degrees of phase margin or more, counting a
 * delay of 1.2 ticks in the loop. The third settles and recovers fastest among those that bear twice the gain and
 * 30 degrees of loop phase; the fourth is the third for short ticks, which bears 2.5 times the gain and 40 degrees and
 * leaves 29 nm instead of 44 where a finger couples the modes. */
static const hd_gains_t TESTED[] = {
    {HD_LAW_PI, 750.0f, 0.005f},
    {HD_LAW_PI_FF, 900.0f, 0.0025f},
    {HD_LAW_DEADBEAT, 2400.0f, 0.0007f},
    {HD_LAW_DEADBEAT, 3000.0f, 0.0005f},
};
#define LAWS (HD_LAW_DEADBEAT + 1)
#define SHORT_TICK_S 0.00025f

static const hd_gains_t *tested_gains(uint8_t law, float tick_s)
{
    return &TESTED[law < HD_LAW_DEADBEAT ? law : tick_s <= SHORT_TICK_S ? HD_LAW_DEADBEAT + 1 : HD_LAW_DEADBEAT];
}

hd_gains_t hd_gains_complete(hd_gains_t gains, float tick_s)
{
    const hd_gains_t *tested = tested_gains(gains.law, tick_s);
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
    return gains->law < LAWS
        && gains->bandwidth_1_s >= HD_BANDWIDTH_MIN_1_S && gains->bandwidth_1_s <= HD_BANDWIDTH_MAX_1_S
        && gains->integral_time_s >= HD_INTEGRAL_TIME_MIN_S && gains->integral_time_s <= HD_INTEGRAL_TIME_MAX_S;
}

/* Feedthrough is subtracted as far as it is known, to a tenth; the rest comes back within a tick, and a loop that is fast
 * for its plate amplifies it. */
#define FEEDTHROUGH_DOUBT 0.1f
#define DOUBT_LIMIT 0.8f /* of what a volt does to the plate while the observer looks: limit cycles begin at 1.1 */

/* What a volt of mode p adds to its own measurement. */
static float feedthrough_um_per_v(const hd_wiring_t *wiring, int p)
{
    float sum_um_per_v = 0.0f;
    for (int k = 0; k < HD_MODES; k++) {
        sum_um_per_v += fabsf(wiring->drive[k][p]) * hd_magnitude(wiring->feedthrough_um_per_v[p][k]);
    }
    return sum_um_per_v;
}

/* The gains, slower by one factor where the feedthrough's doubt would make the loop swing. */
static hd_gains_t bearable(const hd_gains_t *gains, const hd_plant_t *plant)
{
    float speed_1_s = gains->bandwidth_1_s + 1.0f / gains->integral_time_s, slower = 1.0f;
    for (int k = 0; k < HD_MODES; k++) {
        float doubt_um_per_v = FEEDTHROUGH_DOUBT * feedthrough_um_per_v(&plant->wiring, k);
        float limit_um_per_v = DOUBT_LIMIT * plant->model[k].gain_um_per_v_s / speed_1_s;
        slower = doubt_um_per_v > limit_um_per_v ? hd_smaller(slower, limit_um_per_v / doubt_um_per_v) : slower;
    }
    return (hd_gains_t){gains->law, slower * gains->bandwidth_1_s, gains->integral_time_s / slower};
}

/* A sound plate shows at least so much per volt: fingers damp it by up to DULLER, and it drifts by up to 120 Hz. */
#define DULLER 3.0f
#define ADRIFT_RAD_S 754.0f

static float held_um_per_v(const hd_mode_model_t *model)
{
    hd_phasor_t rate_1_s = {DULLER * model->decay_1_s, fabsf(model->detuning_rad_s) + ADRIFT_RAD_S};
    return model->gain_um_per_v_s / hd_magnitude(rate_1_s);
}

static float shown_um_per_v(const hd_design_t *design, int sensor)
{
    float least_um_per_v = FLT_MAX;
    for (int k = 0; k < HD_MODES; k++) {
        if (k == sensor || !design->wires.has_own_sensors) {
            float sees = hd_magnitude(design->wires.sees[sensor][k]);
            least_um_per_v = hd_smaller(least_um_per_v, sees * held_um_per_v(&design->plant.model[k]));
        }
    }
    return least_um_per_v;
}

void hd_control_design(hd_design_t *design)
{
    const hd_plant_t *plant = &design->plant;
    const hd_gains_t *gains = &design->gains;
    float lookahead_s = gains->law == HD_LAW_PI ? 0.0f : (1.0f + plant->output_delay_frac) * plant->tick_s;
    design->lookahead_us = (uint32_t)(lookahead_s * 1e6f + 0.5f);
    /* The paper's law does not look at the observer, and its gains would make a dull plate's swing. */
    const hd_gains_t watch = bearable(gains->law == HD_LAW_PI ? tested_gains(HD_LAW_DEADBEAT, plant->tick_s) : gains, plant);
    design->pole = hd_decay(-watch.bandwidth_1_s * plant->tick_s);
    design->integral_frac = plant->tick_s / gains->integral_time_s;
    design->ticks_per_s = 1.0f / plant->tick_s;
    design->coupling_memory_frac = hd_decay(-plant->tick_s / HD_COUPLING_MEMORY_S);
    hd_phasor_t loop[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        loop[k] = plant->model[k].loop;
        design->doubt_um_per_v[k] = FEEDTHROUGH_DOUBT * feedthrough_um_per_v(&plant->wiring, k);
        hd_observer_design(&design->observer[k], &plant->model[k], plant->tick_s, plant->output_delay_frac,
                           watch.bandwidth_1_s, watch.integral_time_s);
    }
    hd_wiring_design(&design->wires, &plant->wiring, loop);
    for (int k = 0; k < HD_MODES; k++) {
        design->shown_um_per_v[k] = shown_um_per_v(design, k);
        hd_reach_design(&design->reach[k], &design->observer[k], design->wires.back[k],
                        plant->wiring.sense[k], plant->tick_s);
    }
    design->balance = 0u;
    design->balance = 0u - hd_sum_words(design, sizeof *design / sizeof(uint32_t));
}

#define TRIAL_TICKS 200
#define TRIAL_UM 0.05f    /* below what the observer learns from */
#define TRIAL_LIMIT_V 1e6f

/* The mean that a tick shows of the plate as designed, which moves on by it. */
static hd_phasor_t trial_mean(const hd_observer_design_t *mode, const hd_observer_t *observer, hd_phasor_t *w_um)
{
    hd_phasor_t mean_um = hd_mul(mode->mean_of_state, *w_um);
    mean_um = hd_add(mean_um, hd_mul(mode->mean_of_new_um_per_v, observer->new_v));
    mean_um = hd_add(mean_um, hd_mul(mode->mean_of_old_um_per_v, observer->old_v));
    *w_um = hd_add(hd_mul(mode->keep, *w_um), hd_mul(mode->push_um_per_v, observer->new_v));
    return mean_um;
}

bool hd_control_stable(const hd_design_t *design)
{
    static const hd_phasor_t rest_um[HD_MODES];
    hd_control_t control = {.design = *design};
    hd_phasor_t w_um[HD_MODES], mean_um[HD_MODES], voltage_v[HD_MODES];
    bool rests = true;
    for (int k = 0; k < HD_MODES; k++) {
        w_um[k] = control.loop[k].observer.w_um = (hd_phasor_t){TRIAL_UM, 0.0f};
    }
    for (int tick = 0; tick < TRIAL_TICKS; tick++) {
        for (int k = 0; k < HD_MODES; k++) {
            mean_um[k] = trial_mean(&design->observer[k], &control.loop[k].observer, &w_um[k]);
            rests = rests && (tick < TRIAL_TICKS / 2 || hd_within(w_um[k], TRIAL_UM));
        }
        hd_control_step(&control, rest_um, mean_um, TRIAL_LIMIT_V, voltage_v);
    }
    return rests;
}

static bool same_model(const hd_mode_model_t *a, const hd_mode_model_t *b)
{
    return a->decay_1_s == b->decay_1_s && a->detuning_rad_s == b->detuning_rad_s
        && a->gain_um_per_v_s == b->gain_um_per_v_s && a->loop.d == b->loop.d && a->loop.q == b->loop.q;
}

void hd_control_adopt(hd_control_t *control, const hd_design_t *design)
{
    for (int k = 0; k < HD_MODES; k++) {
        if (!same_model(&design->plant.model[k], &control->design.plant.model[k])) {
            control->loop[k] = (hd_loop_t){0};
        }
    }
    control->design = *design;
    hd_control_reset(control);
}

void hd_control_reset(hd_control_t *control)
{
    const hd_phasor_t zero = {0.0f, 0.0f};
    for (int k = 0; k < HD_MODES; k++) {
        hd_loop_t *loop = &control->loop[k];
        loop->x_um[0] = loop->x_um[1] = loop->x_um[2] = loop->integral_v = zero;
        hd_observer_rest(&loop->observer);
    }
}

hd_estimate_t hd_control_estimate(const hd_control_t *control, int mode)
{
    const hd_mode_model_t *model = &control->design.plant.model[mode];
    hd_phasor_t change_1_s = hd_scale(model->gain_um_per_v_s, control->loop[mode].observer.change_v_per_um);
    return (hd_estimate_t){model->decay_1_s - change_1_s.d, model->detuning_rad_s + change_1_s.q};
}

float hd_control_holdable(const hd_control_t *control, int mode, float w_um, float v_limit_v)
{
    hd_phasor_t holding_v[HD_MODES] = {{0.0f, 0.0f}};
    holding_v[mode] = hd_observer_holding_v(&control->loop[mode].observer, &control->design.observer[mode],
                                            (hd_phasor_t){w_um, 0.0f});
    return hd_holdable_fraction(&control->design.wires, holding_v, v_limit_v);
}

static bool decide(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
                   const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t u_v[HD_MODES],
                   hd_phasor_t voltage_v[HD_MODES])
{
    switch (control->design.gains.law) {
    case HD_LAW_PI:
        return hd_law_pi(control, reference_um, measured_um, v_limit_v, u_v, voltage_v);
    case HD_LAW_PI_FF:
        return hd_law_pi_ff(control, reference_um, measured_um, v_limit_v, u_v, voltage_v);
    default:
        return hd_law_deadbeat(control, reference_um, v_limit_v, u_v, voltage_v);
    }
}

/* As large as the law left room for. */
static __attribute__((noinline)) void probe(const hd_control_t *control, hd_phasor_t u_v[HD_MODES], float v_limit_v,
                                            hd_phasor_t voltage_v[HD_MODES])
{
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        u_v[k].d += control->probe_v[k];
    }
    hd_wiring_drive(&control->design.wires, u_v, v_limit_v, voltage_v);
}

bool hd_control_step(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
                     const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t voltage_v[HD_MODES])
{
    hd_phasor_t u_v[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        hd_observer_correct(&control->loop[k].observer, &control->design.observer[k], measured_um[k]);
    }
    hd_loop_t *loop = &control->loop[control->turn];
    hd_phasor_t *own_v_per_um = &loop->coupling_v_per_um[control->turn];
    *own_v_per_um = hd_add(*own_v_per_um, hd_observer_learn(&loop->observer, &control->design.observer[control->turn]));
    hd_couple(control);
    float law_limit_v = v_limit_v - control->probe_frac * v_limit_v;
    bool saturated = decide(control, reference_um, measured_um, law_limit_v, u_v, voltage_v);
    if (control->probes) {
        probe(control, u_v, v_limit_v, voltage_v);
    }
    for (int k = 0; k < HD_MODES; k++) {
        hd_observer_drive(&control->loop[k].observer, u_v[k]);
    }
    return saturated;
}
