#include "plausibility.h"

#include "exponential.h"

#define OVER_AMPLITUDE 1.5f /* of the limit: no controller worth its gains overshoots that far */
#define OVER_AMPLITUDE_TURNS ((8 + HD_MODES - 1) / HD_MODES)

/* Each tick judges one mode and one sensor, in turn: times are counted in turns.
 *
 * While an amplifier is above half its limit: a sensor that reads next to nothing of what is asked (dead), or a mode far from
 * its reference while all modes together give power back (wires inverted or swapped). A plate that only falls short of its
 * reference, or that fingers move elsewhere, does neither. */
#define WATCHED_VOLTAGE 0.5f
#define DEAD_ASKED 0.0025f /* of the limit */
#define DEAD_ANSWER 0.1f   /* of what is asked */
#define DEAD_MOST 0.15f    /* of the limit: no dead sensor reads more */
#define DEAD_NOISE 0.001f  /* of the limit */
#define DEAD_ALONE 0.1f    /* of the limit: less of the other modes holds no mode still against half the voltage */
#define ASTRAY_ANSWER 1.5f /* of what is asked, from it */
#define ASTRAY_FLOOR 0.05f /* of the limit */
#define DISTRUST_S 0.05f

/* A limit cycle drives itself: its voltage answers what surprises the observer. On a sound plate, however it has drifted and
 * whatever touches it, the voltage changes mostly because the reference does. Both are sums over the last turns. */
#define RECENT_S 0.01f
#define SWINGS_S 0.04f
#define LEAST_SWING 0.21f /* RMS of the changes of voltage, of its limit: noise and landing fingers cause as much */

void hd_plausibility_init(hd_core_t *core)
{
    float turns_hz = core->config.control_hz / (float)HD_MODES;
    core->distrust_turns = (uint16_t)(1.0f + turns_hz * DISTRUST_S);
    core->swing_turns = (uint16_t)(1.0f + turns_hz * SWINGS_S);
    core->recent_frac = hd_decay(-1.0f / (turns_hz * RECENT_S));
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

static bool swings(hd_core_t *core, int k)
{
    hd_doubts_t *doubts = &core->doubts[k];
    const hd_observer_t *observer = &core->control.loop[k].observer;
    const hd_observer_design_t *design = &core->control.design.observer[k];
    hd_phasor_t change_v = hd_sub(observer->new_v, observer->old_v), moved_um = hd_sub(core->asked_um[k], doubts->asked_um);
    hd_phasor_t answer_um_v = hd_mul(observer->innovation_um, hd_conj(change_v));
    float planned_v2 = hd_dot(change_v, change_v) + design->hurry_v2_per_um2 * hd_dot(moved_um, moved_um);
    doubts->asked_um = core->asked_um[k];
    doubts->answer_um_v = hd_add(hd_scale(core->recent_frac, doubts->answer_um_v), answer_um_v);
    doubts->planned_v2 = core->recent_frac * doubts->planned_v2 + planned_v2 + core->least_swing_v2;
    bool own = !hd_within(doubts->answer_um_v, design->surprise_um_per_v * doubts->planned_v2);
    return lasts(own, &doubts->swings, core->swing_turns);
}

/* Energy comes from the amplifiers alone: over a few milliseconds no plate gives back more than it takes from them, however
 * far it is from resonance, however damped, and whatever fingers do to its modes, unless wires are not as the board believes. */
static bool gives_back(hd_core_t *core, int k)
{
    float taken_um_v = hd_dot(core->measured_um[k], core->control.loop[k].observer.new_v);
    core->taken_um2_s = core->recent_frac * core->taken_um2_s + core->control.design.plant.model[k].gain_um_per_v_s * taken_um_v;
    return core->taken_um2_s < 0.0f;
}

/* Whether an amplifier that drives the mode is above half its limit. */
static bool driven_hard(const hd_core_t *core, int k)
{
    uint32_t shares = core->control.design.wires.shares[k];
    bool hard = false;
    for (int n = 0; n < HD_MODES; n++) {
        hard = hard || ((shares & 1u << n) != 0 && !hd_within(core->voltage_v[n], WATCHED_VOLTAGE * core->config.v_limit_v));
    }
    return hard;
}

/* Whether a sensor reads nothing of what is asked. While others read much, fingers may hold a mode nearly still. */
static bool is_dead(const hd_core_t *core, int k)
{
    float limit_um = core->config.w_limit_um[k];
    const hd_wires_t *wires = &core->control.design.wires;
    float expected = hd_magnitude(wires->has_own_sensors ? core->asked_um[k] : hd_row(wires->sees[k], core->asked_um));
    if (!(expected > DEAD_ASKED * limit_um && hd_within(core->sensor_um[k], DEAD_ANSWER * expected + DEAD_NOISE * limit_um))) {
        return false;
    }
    bool alone = true;
    for (int n = 0; n < HD_MODES; n++) {
        alone = alone && (n == k || hd_within(core->sensor_um[n], DEAD_ALONE * core->config.w_limit_um[n]));
    }
    return alone || hd_within(core->sensor_um[k], DEAD_NOISE * limit_um);
}

/* Judges a mode that is driven hard, and the sensor of its number, by the measurement against the voltage and the
 * reference of the tick before, which caused it. */
static enum hd_fault hard_driven_fault(hd_core_t *core, int k, bool backwards)
{
    hd_phasor_t asked_um = core->asked_um[k];
    float usual_um = ASTRAY_ANSWER * hd_magnitude(asked_um) + ASTRAY_FLOOR * core->config.w_limit_um[k];
    bool astray = backwards && !hd_within(hd_sub(core->measured_um[k], asked_um), usual_um);
    bool dead = lasts(is_dead(core, k), &core->doubts[k].dead, core->distrust_turns);
    bool wiring = lasts(astray, &core->doubts[k].astray, core->distrust_turns);
    return dead ? HD_FAULT_NO_RESPONSE : wiring ? HD_FAULT_WIRING : HD_FAULT_NONE;
}

enum hd_fault hd_implausible(hd_core_t *core)
{
    int k = core->control.turn;
    enum hd_fault fault = HD_FAULT_NONE;
    bool backwards = gives_back(core, k);
    bool little = hd_within(core->sensor_um[k], DEAD_MOST * core->config.w_limit_um[k]);
    if ((backwards || little) && driven_hard(core, k)) {
        fault = hard_driven_fault(core, k, backwards);
    } else {
        core->doubts[k].dead = core->doubts[k].astray = 0;
    }
    bool over = !hd_within(core->measured_um[k], OVER_AMPLITUDE * core->config.w_limit_um[k]);
    if (lasts(over, &core->doubts[k].over_amplitude, OVER_AMPLITUDE_TURNS)) {
        return 8 * core->doubts[k].astray >= core->distrust_turns ? HD_FAULT_WIRING : HD_FAULT_OVER_AMPLITUDE;
    }
    if (lasts(core->clips && core->ramp > 0, &core->doubts[k].clipped, core->distrust_turns)) {
        return HD_FAULT_CLIPPED;
    }
    return swings(core, k) ? HD_FAULT_ASTRAY : fault;
}
