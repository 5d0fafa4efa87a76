#include "plausibility.h"

#include <string.h>

#define OVER_AMPLITUDE 1.5f /* of the limit: no controller worth its gains overshoots that far */
#define OVER_AMPLITUDE_TICKS 8

/* A sensor that cannot be believed, while the output is above half its limit: next to nothing of the reference comes
 * back (dead), or something so far from it that no plate does it (inverted, swapped, of a wrong phase or gain, a limit
 * cycle). A plate that only falls short of its reference, as with drift or a heavy finger, measures less than it. */
#define WATCHED_VOLTAGE 0.5f
#define DEAD_ASKED 0.0025f /* of the limit */
#define DEAD_ANSWER 0.1f   /* of what is asked */
#define ASTRAY_ANSWER 1.5f /* of what is asked, from it */
#define ASTRAY_FLOOR 0.05f /* of the limit */
#define DISTRUST_S 0.05f

/* A limit cycle about a reference that is not small: the voltage swings from tick to tick. Reports come every 10 ms, and
 * even steps of the whole range then swing it on less than two ticks of five, where the count no longer grows. */
#define SWING_VOLTAGE 0.3f /* of the limit, from one tick to the next */
#define SWING_UP 3
#define SWING_DOWN 2

#define AGAINST_S 0.01f /* longer than it takes to brake any amplitude; a limit cycle changes sides sooner */

void hd_plausibility_init(hd_core_t *core)
{
    core->distrust_limit_ticks = (uint16_t)(core->config.control_hz * DISTRUST_S);
    core->against_limit_ticks = (uint16_t)(core->config.control_hz * AGAINST_S);
}

void hd_plausibility_reset(hd_core_t *core)
{
    memset(core->over_amplitude_ticks, 0, sizeof core->over_amplitude_ticks);
    memset(core->dead_ticks, 0, sizeof core->dead_ticks);
    memset(core->astray_ticks, 0, sizeof core->astray_ticks);
    memset(core->swings, 0, sizeof core->swings);
    memset(core->previous_v, 0, sizeof core->previous_v);
    memset(core->against_ticks, 0, sizeof core->against_ticks);
}

/* Counts the ticks in a row for which a condition holds, up to the limit. */
static bool lasts(bool condition, uint16_t *ticks, uint16_t limit)
{
    *ticks = !condition ? 0 : *ticks < limit ? (uint16_t)(*ticks + 1) : limit;
    return *ticks >= limit;
}

/* Whether an amplifier's voltage swings on more ticks than references explain, for as long as `lasts`. */
static bool cycles(hd_core_t *core, int k)
{
    float swing_v = SWING_VOLTAGE * core->config.v_limit_v;
    bool swings = !hd_within(hd_sub(core->voltage_v[k], core->previous_v[k]), swing_v);
    core->previous_v[k] = core->voltage_v[k];
    int count = core->swings[k] + (swings ? SWING_UP : -SWING_DOWN);
    int limit = SWING_UP * core->distrust_limit_ticks;
    core->swings[k] = (uint16_t)(count < 0 ? 0 : count > limit ? limit : count);
    return count >= limit;
}

/* The amplifiers above half their limit, one bit each. */
static uint32_t amplifiers_driven_hard(const hd_core_t *core)
{
    uint32_t hard = 0;
    for (int k = 0; k < HD_MODES; k++) {
        hard |= hd_within(core->voltage_v[k], WATCHED_VOLTAGE * core->config.v_limit_v) ? 0u : 1u << k;
    }
    return hard;
}

/* The fault, or that of the wires if the mode as measured keeps giving power back: what takes its drive's power, however
 * far it is from resonance and however damped, is wired as the board believes. */
static enum hd_fault against(const hd_core_t *core, int k, enum hd_fault fault)
{
    return core->against_ticks[k] >= core->against_limit_ticks ? HD_FAULT_WIRING : fault;
}

/* Judges a mode that is driven hard by its measurement against the voltage and the reference of the tick before, which
 * caused it. */
static enum hd_fault hard_driven_fault(hd_core_t *core, int k)
{
    float limit_um = core->config.w_limit_um[k];
    hd_phasor_t measured_um = core->measured_um[k], asked_um = core->asked_um[k];
    float asked = hd_magnitude(asked_um);
    bool dead = asked > DEAD_ASKED * limit_um && hd_within(measured_um, DEAD_ANSWER * asked);
    bool astray = !hd_within(hd_sub(measured_um, asked_um), ASTRAY_ANSWER * asked + ASTRAY_FLOOR * limit_um);
    float gained_um_v = hd_dot(measured_um, core->control.loop[k].observer.new_v);
    lasts(gained_um_v < 0.0f, &core->against_ticks[k], core->against_limit_ticks);
    bool is_dead = lasts(dead, &core->dead_ticks[k], core->distrust_limit_ticks);
    bool is_astray = lasts(astray, &core->astray_ticks[k], core->distrust_limit_ticks);
    return is_dead ? HD_FAULT_NO_RESPONSE : is_astray ? against(core, k, HD_FAULT_ASTRAY) : HD_FAULT_NONE;
}

static enum hd_fault mode_fault(hd_core_t *core, int k, bool is_driven_hard)
{
    enum hd_fault fault = HD_FAULT_NONE;
    if (is_driven_hard) {
        fault = hard_driven_fault(core, k);
    } else {
        core->dead_ticks[k] = core->astray_ticks[k] = core->against_ticks[k] = 0;
    }
    bool over = !hd_within(core->measured_um[k], OVER_AMPLITUDE * core->config.w_limit_um[k]);
    if (lasts(over, &core->over_amplitude_ticks[k], OVER_AMPLITUDE_TICKS)) {
        return against(core, k, HD_FAULT_OVER_AMPLITUDE);
    }
    return cycles(core, k) ? HD_FAULT_ASTRAY : fault;
}

enum hd_fault hd_implausible(hd_core_t *core, int *mode)
{
    uint32_t hard = amplifiers_driven_hard(core);
    for (int k = 0; k < HD_MODES; k++) {
        enum hd_fault fault = mode_fault(core, k, (core->control.design.wires.shares[k] & hard) != 0);
        if (fault != HD_FAULT_NONE) {
            *mode = k;
            return fault;
        }
    }
    return HD_FAULT_NONE;
}
