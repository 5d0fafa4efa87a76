#include "plausibility.h"

#include "exponential.h"
#include "reach_watch.h"

#define OVER_AMPLITUDE 1.5f /* of the limit: no controller worth its gains overshoots that far */
#define OVER_AMPLITUDE_TURNS ((8 + HD_MODES - 1) / HD_MODES)

/* Each tick judges one mode and one sensor, in turn: times are counted in turns.
 *
 * While an amplifier is above half its limit: a sensor that reads next to nothing of what is asked (dead), or modes that take
 * less power than any plate (wires inverted or swapped). A plate that only falls short of its reference, or that fingers move
 * elsewhere, does neither. */
#define WATCHED_VOLTAGE 0.5f
#define DEAD_ASKED 0.0025f /* of the limit */
#define DEAD_ANSWER 0.1f   /* of what is asked, or of what the limit's voltage holds of it */
#define DEAD_MOST 0.15f    /* of the limit: no dead sensor reads more */
#define DEAD_NOISE 0.001f  /* of the limit */
#define DEAD_ALONE 0.1f    /* of the limit: less of the other modes holds no mode still against half the voltage */
#define DISTRUST_S 0.05f
#define UNHEARD 0.04f      /* of the limit: fingers that hold a mode leave more of it */

#define PHASE_RAD 0.2f     /* by which a loop may be off: so much of the power that only goes to and fro may be missing */
#define FINGERS_1_S 1500.0f /* the most that fingers add to a mode's decay; one moist, pressing fingertip adds 345 */

/* A limit cycle drives itself: its voltage answers what surprises the observer. On a sound plate, however it has drifted and
 * whatever touches it, the voltage changes mostly because the reference does. Both are sums over the last turns. */
#define RECENT_S 0.01f
#define SWINGS_S 0.04f
#define LEAST_SWING 0.21f /* RMS of the changes of voltage, of its limit: noise and landing fingers cause as much */
#define FADED2 0.25f      /* the square of a half: what probes only struck is below that of its most by the end of SWINGS_S */

void hd_plausibility_init(hd_core_t *core)
{
    float turns_hz = core->config.control_hz / (float)HD_MODES;
    core->distrust_turns = (uint16_t)(1.0f + turns_hz * DISTRUST_S);
    core->swing_turns = (uint16_t)(1.0f + turns_hz * SWINGS_S);
    core->recent_frac = hd_decay(-1.0f / (turns_hz * RECENT_S));
    core->recent_ticks = (uint16_t)(RECENT_S * core->config.control_hz);
    float least_v = LEAST_SWING * core->config.v_limit_v;
    core->least_swing_v2 = least_v * least_v;
}

/* Counts the turns in a row for which a condition holds. */
static bool lasts(bool condition, uint16_t *count, uint16_t limit)
{
    if (!condition) {
        *count = 0;
        return false;
    }
    *count = (uint16_t)(*count + 1);
    return *count >= limit;
}

/* Whether what swings has done so for long, and is no ringing that probes struck and that dies away. */
static __attribute__((noinline)) bool goes_on(const hd_core_t *core, hd_doubts_t *doubts)
{
    float answer2 = hd_dot(doubts->answer_um_v, doubts->answer_um_v);
    if (doubts->swings == 0) {
        doubts->most_answer2 = 0.0f;
        doubts->struck = core->struck_tick != 0 && core->sweep.ticks - core->struck_tick < core->recent_ticks;
    }
    doubts->most_answer2 = answer2 > doubts->most_answer2 ? answer2 : doubts->most_answer2;
    if (!lasts(true, &doubts->swings, core->swing_turns)) {
        return false;
    }
    doubts->swings = 0;
    return !doubts->struck || answer2 > FADED2 * doubts->most_answer2;
}

static bool swings(hd_core_t *core, int k)
{
    hd_doubts_t *doubts = &core->doubts[k];
    const hd_observer_t *observer = &core->control.loop[k].observer;
    const hd_observer_design_t *design = &core->control.design.observer[k];
    hd_phasor_t change_v = hd_sub(observer->new_v, observer->old_v), moved_um = hd_sub(core->asked_um[k], doubts->asked_um);
    hd_phasor_t answer_um_v = hd_mul(observer->innovation_um, hd_conj(change_v));
    float planned_v2 = hd_dot(change_v, change_v) + design->hurry_v2_per_um2 * hd_dot(moved_um, moved_um);
    answer_um_v = hd_add(hd_scale(core->recent_frac, doubts->answer_um_v), answer_um_v);
    planned_v2 = core->recent_frac * doubts->planned_v2 + planned_v2 + core->least_swing_v2;
    bool own = !hd_within(answer_um_v, design->surprise_um_per_v * planned_v2);
    doubts->asked_um = core->asked_um[k];
    doubts->answer_um_v = answer_um_v;
    doubts->planned_v2 = planned_v2;
    if (!own) {
        doubts->swings = 0;
    }
    return own && goes_on(core, doubts);
}

static float surely_taken(hd_phasor_t power_um2_s)
{
    return power_um2_s.d + PHASE_RAD * fabsf(power_um2_s.q);
}

/* All modes together, with what fingers need to feed this one: the next comment has the bound. */
static bool takes_less(hd_phasor_t all_um2_s, hd_phasor_t own_um2_s, float w_um2)
{
    float fed_um2_s = hd_smaller(0.0f, surely_taken(own_um2_s));
    return surely_taken(all_um2_s) * FINGERS_1_S * w_um2 < fed_um2_s * fed_um2_s;
}

/* Feedthrough that is known to a tenth may hide c |u|^2 of the power, and |u|^2 is at least |conj(W) u|^2 / |W|^2. */
static bool is_explained_by_feedthrough(const hd_core_t *core, int k)
{
    hd_phasor_t all_um2_s = {0.0f, 0.0f}, own_um2_s = {0.0f, 0.0f};
    for (int n = 0; n < HD_MODES; n++) {
        const hd_mode_model_t *model = &core->control.design.plant.model[n];
        hd_phasor_t spare_um2_s = core->doubts[n].spare_um2_s, taken_um2_s = spare_um2_s;
        taken_um2_s.d += core->control.design.observer[n].least_taken_1_s * core->doubts[n].w_um2;
        if (core->doubts[n].w_um2 > 0.0f) {
            spare_um2_s.d += core->control.design.doubt_um_per_v[n] * hd_dot(taken_um2_s, taken_um2_s)
                             / (model->gain_um_per_v_s * core->doubts[n].w_um2);
        }
        all_um2_s = hd_add(all_um2_s, spare_um2_s);
        own_um2_s = n == k ? spare_um2_s : own_um2_s;
    }
    return !takes_less(all_um2_s, own_um2_s, core->doubts[k].w_um2);
}

/* Energy comes from the amplifiers alone, and goes into damping: over some milliseconds, all modes together take what any
 * plate's damping takes at least, however far it is from resonance. Fingers that move a mode from others cost more:
 *
 *   conj(W_k) (F W)_k <= sqrt(F_kk |W_k|^2  conj(W) F W)        for their damping F, which is positive semi-definite
 *
 * so that a mode to which they feed P makes all modes take P^2 / (F_kk |W_k|^2) besides. Less than that is taken only where
 * wires are not as the board believes. */
static bool gives_back(hd_core_t *core, int k)
{
    hd_doubts_t *doubts = &core->doubts[k];
    const hd_mode_model_t *model = &core->control.design.plant.model[k];
    hd_observer_t *observer = &core->control.loop[k].observer;
    hd_phasor_t spare_um2_s = hd_scale(model->gain_um_per_v_s, observer->taken_um_v);
    spare_um2_s.d -= core->control.design.observer[k].least_taken_1_s * observer->w_um2;
    spare_um2_s = hd_add(hd_scale(core->recent_frac, doubts->spare_um2_s), spare_um2_s);
    float w_um2 = core->recent_frac * doubts->w_um2 + observer->w_um2;
    doubts->spare_um2_s = spare_um2_s;
    doubts->w_um2 = w_um2;
    observer->taken_um_v = (hd_phasor_t){0.0f, 0.0f};
    observer->w_um2 = 0.0f;

    hd_phasor_t all_um2_s = core->doubts[0].spare_um2_s;
    for (int n = 1; n < HD_MODES; n++) {
        all_um2_s = hd_add(all_um2_s, core->doubts[n].spare_um2_s);
    }
    bool less = takes_less(all_um2_s, spare_um2_s, w_um2);
    return less && (core->control.design.wires.has_own_sensors || !is_explained_by_feedthrough(core, k));
}

/* Whether an amplifier that drives the mode is above half its limit, or would be if reach.h let it. */
static bool driven_hard(const hd_core_t *core, int k)
{
    uint32_t shares = core->control.design.wires.shares[k];
    bool hard = core->allowed_v < core->config.v_limit_v;
    for (int n = 0; n < HD_MODES; n++) {
        hard = hard || ((shares & 1u << n) != 0 && !hd_within(core->voltage_v[n], WATCHED_VOLTAGE * core->config.v_limit_v));
    }
    return hard;
}

/* A lead that broke while next to nothing was asked contradicts no expectation: the voltage slowly grows.
 * (A step's beginning is over.) */
static inline void ask_the_unheard(hd_core_t *core, int k)
{
    hd_unheard_t *unheard = &core->unheard[k];
    uint32_t tick = core->sweep.ticks, turns = unheard->turns + 1u;
    turns = tick - unheard->tick == HD_MODES ? turns : 0u;
    unheard->tick = tick;
    unheard->turns = turns;
    if (turns == core->renew_turns / HD_HURRY && hd_within(core->sensor_um[k], UNHEARD * core->config.w_limit_um[k])) {
        hd_reach_ask(core, k);
    }
}

/* Whether a sensor, whose mode is driven hard, reads nothing of what is asked; one that reads little for long is asked here, too.
 * While others read much, fingers may hold a mode nearly still. */
static bool is_dead(hd_core_t *core, int k)
{
    ask_the_unheard(core, k);
    float limit_um = core->config.w_limit_um[k];
    const hd_wires_t *wires = &core->control.design.wires;
    float expected = hd_magnitude(wires->has_own_sensors ? core->asked_um[k] : hd_row(wires->sees[k], core->asked_um));
    float held_um = core->control.design.shown_um_per_v[k] * core->config.v_limit_v;
    float dead_um = DEAD_ANSWER * hd_smaller(expected, held_um) + DEAD_NOISE * limit_um;
    if (!(expected > DEAD_ASKED * limit_um && hd_within(core->sensor_um[k], dead_um))) {
        return false;
    }
    bool alone = true;
    for (int n = 0; n < HD_MODES; n++) {
        alone = alone && (n == k || hd_within(core->sensor_um[n], DEAD_ALONE * core->config.w_limit_um[n]));
    }
    return alone || hd_within(core->sensor_um[k], DEAD_NOISE * limit_um);
}

/* A sensor that says nothing while nothing is asked of it, or little is driven, is as dead as it was before. */
static bool stays_dead(hd_core_t *core, int k, bool dead)
{
    bool speaks = !hd_within(core->sensor_um[k], DEAD_NOISE * core->config.w_limit_um[k]);
    return (dead || speaks) && lasts(dead, &core->doubts[k].dead, core->distrust_turns);
}

enum hd_fault hd_implausible(hd_core_t *core)
{
    int k = core->control.turn;
    hd_doubts_t *doubts = &core->doubts[k];
    bool over = !hd_within(core->measured_um[k], OVER_AMPLITUDE * core->config.w_limit_um[k]);
    if (lasts(over, &doubts->over_amplitude, OVER_AMPLITUDE_TURNS)) {
        return 8 * doubts->backwards >= core->distrust_turns ? HD_FAULT_WIRING : HD_FAULT_OVER_AMPLITUDE;
    }
    bool backwards = gives_back(core, k);
    bool little = hd_within(core->sensor_um[k], DEAD_MOST * core->config.w_limit_um[k]);
    bool hard = (backwards || little) && driven_hard(core, k);
    bool wiring = lasts(hard && backwards, &doubts->backwards, core->distrust_turns) && doubts->spare_um2_s.d < 0.0f;
    if (stays_dead(core, k, hard && is_dead(core, k))) {
        return HD_FAULT_NO_RESPONSE;
    }
    if (lasts(core->clips && core->ramp > 0, &doubts->clipped, core->distrust_turns)) {
        return HD_FAULT_CLIPPED;
    }
    return swings(core, k) ? HD_FAULT_ASTRAY : wiring ? HD_FAULT_WIRING : HD_FAULT_NONE;
}
