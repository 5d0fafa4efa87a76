#include "observer.h"

#include "exponential.h"
#include "limiter.h"

/* The state is corrected faster than the disturbance; otherwise the law's pole would act twice. */
#define STATE_BANDWIDTHS 2.0f

/* Long enough to resolve 1 Hz and 5 % at a tenth of a micrometre with 14 bits of noise, short against a finger's
 * stroke across an antinode. */
#define MEMORY_S 0.02f
#define LEAST_UM 0.1f

#define CHANGE_LIMIT_PER_TICK 0.25f
#define ABSURD_PER_TICK 0.25f /* of all amplitudes, that a disturbance moves a mode by */
#define SURPRISE 0.4f /* innovation per change of voltage: of limit cycles at least 0.6 of |b|, on sound plates at most 0.16 */
#define HURRY 0.5f    /* of the voltage that a change of the reference within a tick would take */
#define LEAST_DAMPING 0.25f /* of the model's: plates have half of it at least, and gains are known to a factor of 2 */
#define FAR_DECAYS 2.0f       /* of detuning, which LEAST_DAMPING covers; beyond, power mostly goes to and fro */
#define PHASES_APART_RAD 0.2f /* by which each mode's loop may be off in its own way, and hide so much of that */
#define NEWEST 4.0f /* times what the observer takes at once: most of it with the tested gains, little with slow ones */

static const hd_phasor_t ONE = {1.0f, 0.0f};
static const hd_phasor_t ZERO = {0.0f, 0.0f};

/* The plate between two changes of voltage, and the mean that a tick around one of them sees. The state is the one at
 * the change: the mean looks back from it under the old voltage and ahead under the new. */
static void describe_tick(hd_observer_design_t *design, const hd_mode_model_t *model, float tick_s, float delay_frac)
{
    hd_phasor_t rate_1_s = {-model->decay_1_s, model->detuning_rad_s};
    float gain = model->gain_um_per_v_s, back_frac = delay_frac, ahead_frac = 1.0f - delay_frac;
    hd_exponential_t whole = hd_exponential(hd_scale(tick_s, rate_1_s));
    hd_exponential_t ahead = hd_exponential(hd_scale(ahead_frac * tick_s, rate_1_s));
    hd_exponential_t back = hd_exponential(hd_scale(-back_frac * tick_s, rate_1_s));

    design->keep = whole.exp;
    design->old_frac = delay_frac;
    design->push_um_per_v = hd_scale(gain * tick_s, whole.phi1);
    design->mean_of_state = hd_add(hd_scale(ahead_frac, ahead.phi1), hd_scale(back_frac, back.phi1));
    design->mean_of_new_um_per_v = hd_scale(gain * tick_s * ahead_frac * ahead_frac, ahead.phi2);
    design->mean_of_old_um_per_v = hd_scale(-gain * tick_s * back_frac * back_frac, back.phi2);
}

/* Poles of the error at `state_pole` and `disturbance_pole`, by comparison of coefficients. */
static void place_poles(hd_observer_design_t *design, float state_pole, float disturbance_pole)
{
    hd_phasor_t a = design->keep, b = design->push_um_per_v, c = design->mean_of_state;
    hd_phasor_t e = hd_add(design->mean_of_new_um_per_v, design->mean_of_old_um_per_v);
    hd_phasor_t visible_um_per_v = hd_add(hd_mul(b, c), hd_mul(hd_sub(ONE, a), e));
    hd_phasor_t corrected = {(1.0f - state_pole) * (1.0f - disturbance_pole), 0.0f};
    design->disturbance_gain_v_per_um = hd_div(corrected, visible_um_per_v);

    hd_phasor_t kept = hd_div((hd_phasor_t){state_pole * disturbance_pole, 0.0f}, a);
    hd_phasor_t by_disturbance = hd_mul(e, design->disturbance_gain_v_per_um);
    design->state_gain = hd_div(hd_sub(hd_sub(ONE, kept), by_disturbance), c);
}

void hd_observer_design(hd_observer_design_t *design, const hd_mode_model_t *model, float tick_s,
                        float output_delay_frac, float bandwidth_1_s, float integral_time_s)
{
    design->model = *model;
    design->v_per_um_s = 1.0f / model->gain_um_per_v_s;
    design->holding_v_per_um = hd_scale(design->v_per_um_s, (hd_phasor_t){model->decay_1_s, -model->detuning_rad_s});
    describe_tick(design, model, tick_s, output_delay_frac);
    float far_rad_s = fabsf(model->detuning_rad_s) - FAR_DECAYS * model->decay_1_s;
    design->least_taken_1_s = LEAST_DAMPING * model->decay_1_s - (far_rad_s > 0.0f ? PHASES_APART_RAD * far_rad_s : 0.0f);
    design->push_v_per_um = hd_div(ONE, design->push_um_per_v);
    design->surprise_um_per_v = SURPRISE * model->gain_um_per_v_s * tick_s;
    float hurry_v_per_um = HURRY * design->v_per_um_s / tick_s;
    design->hurry_v2_per_um2 = hurry_v_per_um * hurry_v_per_um;
    float state_pole = hd_decay(-STATE_BANDWIDTHS * bandwidth_1_s * tick_s);
    float disturbance_pole = hd_decay(-tick_s / integral_time_s);
    place_poles(design, state_pole, disturbance_pole);
    design->poles_sum = state_pole + disturbance_pole;
    design->poles_product = state_pole * disturbance_pole;
    float newest = hd_smaller(1.0f, NEWEST * (1.0f - state_pole) * (1.0f - disturbance_pole));
    design->newest_v_per_um = newest * design->v_per_um_s / tick_s;
    float absurd_v_per_um = ABSURD_PER_TICK * design->v_per_um_s / tick_s;
    design->absurd_v2_per_um2 = absurd_v_per_um * absurd_v_per_um;
    design->memory_frac = hd_decay(-(float)HD_MODES * tick_s / MEMORY_S);
    design->change_limit_v_per_um = CHANGE_LIMIT_PER_TICK * design->v_per_um_s / tick_s;
}

void hd_observer_rest(hd_observer_t *observer)
{
    observer->innovation_um = observer->before_um = observer->w_um = observer->disturbance_v = observer->new_v = observer->old_v = ZERO;
    observer->taken_um_v = ZERO;
    observer->w_um2 = 0.0f;
}

/* Nothing is learned from a mode that hardly moves, nor from what is not finite: what is known stays as it is. */
hd_phasor_t hd_observer_learn(hd_observer_t *observer, const hd_observer_design_t *design)
{
    hd_phasor_t w_um = observer->before_um, before_v_per_um = observer->change_v_per_um;
    float power_um2 = hd_dot(w_um, w_um);
    if (!(power_um2 > LEAST_UM * LEAST_UM)) {
        return ZERO;
    }
    hd_phasor_t moment = hd_mul(hd_conj(w_um), observer->disturbance_v);
    power_um2 += design->memory_frac * observer->power_um2;
    moment = hd_add(moment, hd_scale(design->memory_frac, observer->moment_v_um));
    if (hd_finite(moment) && power_um2 <= FLT_MAX) {
        observer->moment_v_um = moment;
        observer->power_um2 = power_um2;
        observer->learned_turns++;
        observer->change_v_per_um = hd_limit_magnitude(hd_scale(1.0f / power_um2, moment), design->change_limit_v_per_um);
    }
    return hd_sub(observer->change_v_per_um, before_v_per_um);
}

void hd_observer_correct(hd_observer_t *observer, const hd_observer_design_t *design, hd_phasor_t measured_um)
{
    hd_phasor_t mean_v = hd_add(observer->new_v, hd_scale(design->old_frac, hd_sub(observer->old_v, observer->new_v)));
    observer->taken_um_v = hd_add(observer->taken_um_v, hd_mul(hd_conj(measured_um), mean_v));
    observer->w_um2 += hd_dot(measured_um, measured_um);

    hd_phasor_t disturbance_v = observer->disturbance_v;
    hd_phasor_t expected_um = hd_mul(design->mean_of_state, observer->w_um);
    expected_um = hd_add(expected_um, hd_mul(design->mean_of_new_um_per_v, hd_add(observer->new_v, disturbance_v)));
    expected_um = hd_add(expected_um, hd_mul(design->mean_of_old_um_per_v, hd_add(observer->old_v, disturbance_v)));
    hd_phasor_t innovation_um = hd_sub(measured_um, expected_um);
    observer->innovation_um = innovation_um;

    hd_phasor_t before_um = hd_add(observer->w_um, hd_mul(design->state_gain, innovation_um));
    observer->before_um = before_um;
    disturbance_v = hd_add(disturbance_v, hd_mul(design->disturbance_gain_v_per_um, innovation_um));
    observer->disturbance_v = disturbance_v;
    hd_phasor_t driven_v = hd_add(observer->new_v, disturbance_v);
    observer->w_um = hd_add(hd_mul(design->keep, before_um), hd_mul(design->push_um_per_v, driven_v));
}
