#include "plausibility.h"

#define OVER_AMPLITUDE 1.5f /* of the limit: no controller worth its gains overshoots that far */
#define OVER_AMPLITUDE_TURNS ((8 + HD_MODES - 1) / HD_MODES)

/* Each tick judges one mode and one sensor, in turn: times are counted in turns.
 *
 * A sensor that cannot be believed, while the output is above half its limit: next to nothing of the reference comes
 * back (dead), or something so far from it that no plate does it (inverted, swapped, of a wrong phase or gain, a limit
 * cycle). A plate that only falls short of its reference, as with drift or a heavy finger, measures less than it. */
#define WATCHED_VOLTAGE 0.5f
#define DEAD_ASKED 0.0025f /* of the limit */
#define DEAD_ANSWER 0.1f   /* of what is asked */
#define DEAD_NOISE 0.001f  /* of the limit */
#define ASTRAY_ANSWER 1.5f /* of what is asked, from it */
#define ASTRAY_FLOOR 0.05f /* of the limit */
#define DISTRUST_S 0.05f

/* A limit cycle, or a plate that is not the model's: the observer is surprised at every tick, and not at one of twenty, as
 * by steps and fingers. The count no longer grows below two of five. */
#define SURPRISE_UP 3
#define SURPRISE_DOWN 2

#define AGAINST_S 0.01f /* longer than it takes to brake any amplitude; a limit cycle changes sides sooner */

void hd_plausibility_init(hd_core_t *core)
{
    float turns_hz = core->config.control_hz / (float)HD_MODES;
    core->distrust_turns = (uint16_t)(1.0f + turns_hz * DISTRUST_S);
    core->against_turns = (uint16_t)(1.0f + turns_hz * AGAINST_S);
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

/* Whether the mode is astray from its model on more ticks than references and fingers explain, for as long as `lasts`. */
static bool surprises(hd_core_t *core, int k)
{
    float usual_um = core->config.v_limit_v * core->control.design.observer[k].surprise_um_per_v;
    bool surprise = !hd_within(core->control.loop[k].observer.innovation_um, usual_um);
    int count = core->doubts[k].surprises + (surprise ? SURPRISE_UP : -SURPRISE_DOWN);
    core->doubts[k].surprises = (uint16_t)(count < 0 ? 0 : count);
    return count >= SURPRISE_UP * core->distrust_turns;
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

/* The fault, or that of the wires if the mode as measured keeps giving power back: what takes its drive's power, however
 * far it is from resonance and however damped, is wired as the board believes. */
static enum hd_fault against(const hd_core_t *core, int k, enum hd_fault fault)
{
    return core->doubts[k].against >= core->against_turns ? HD_FAULT_WIRING : fault;
}

/* Judges a mode that is driven hard, and the sensor of its number, by the measurement against the voltage and the
 * reference of the tick before, which caused it. */
static enum hd_fault hard_driven_fault(hd_core_t *core, int k)
{
    float limit_um = core->config.w_limit_um[k];
    hd_phasor_t measured_um = core->measured_um[k], asked_um = core->asked_um[k];
    float asked = hd_magnitude(asked_um);
    const hd_wires_t *wires = &core->control.design.wires;
    float expected = wires->has_own_sensors ? asked : hd_magnitude(hd_row(wires->sees[k], core->asked_um));
    bool dead = expected > DEAD_ASKED * limit_um && hd_within(core->sensor_um[k], DEAD_ANSWER * expected + DEAD_NOISE * limit_um);
    bool astray = !hd_within(hd_sub(measured_um, asked_um), ASTRAY_ANSWER * asked + ASTRAY_FLOOR * limit_um);
    float gained_um_v = hd_dot(measured_um, core->control.loop[k].observer.new_v);
    lasts(gained_um_v < 0.0f, &core->doubts[k].against, core->against_turns);
    bool is_dead = lasts(dead, &core->doubts[k].dead, core->distrust_turns);
    bool is_astray = lasts(astray, &core->doubts[k].astray, core->distrust_turns);
    return is_dead ? HD_FAULT_NO_RESPONSE : is_astray ? against(core, k, HD_FAULT_ASTRAY) : HD_FAULT_NONE;
}

enum hd_fault hd_implausible(hd_core_t *core)
{
    int k = core->control.turn;
    enum hd_fault fault = HD_FAULT_NONE;
    if (driven_hard(core, k)) {
        fault = hard_driven_fault(core, k);
    } else {
        core->doubts[k].dead = core->doubts[k].astray = core->doubts[k].against = 0;
    }
    bool over = !hd_within(core->measured_um[k], OVER_AMPLITUDE * core->config.w_limit_um[k]);
    if (lasts(over, &core->doubts[k].over_amplitude, OVER_AMPLITUDE_TURNS)) {
        return against(core, k, HD_FAULT_OVER_AMPLITUDE);
    }
    if (lasts(core->clips && core->ramp > 0, &core->doubts[k].clipped, core->distrust_turns)) {
        return HD_FAULT_CLIPPED;
    }
    return surprises(core, k) ? HD_FAULT_ASTRAY : fault;
}
