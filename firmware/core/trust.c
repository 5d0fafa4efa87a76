#include "trust.h"

#include "exponential.h"

#define MEMORY_S 0.005f    /* of the sums: ten ticks at 2 kHz, in which R comes to its limit from rest at full voltage */
#define FOLLOWED_S 0.01f   /* after a change of the voltage: the sums have forgotten it then */
#define MISSED2 0.11f      /* MISSED is a third: gains are known to a tenth, damped plates answer by another, half a signal is lost */
#define TRUST_S 0.5f       /* a sensor that slowly loses its signal loses 2 % meanwhile */
#define RENEW_S 0.04f      /* before the trust ends: long enough for an answer, so that nothing sound is ever held back */
#define SURPRISE2 0.5f     /* of what changes of the voltage do: more was no change of theirs, and ends the trust */
#define SURPRISE_FRAC 0.01f /* of the largest limit: a sensor sees as much of other modes; less moves no mode away */
#define SETTLING_TICKS 5   /* for which the observer still follows what surprised it */

#define CONTRARY 0.5f      /* of what probes do: a sensor that shows surely less is broken; damped and drifted plates show more */
#define SURE2 10.0f        /* the square of how many standard deviations are sure */
#define ENOUGH 24          /* ticks of probes, before */
#define SURE_S 0.06f       /* memory of those sums */
#define PATIENCE_S 0.065f  /* in which what is asked shows a sensor to be sound, or wrong wires and loops are named, before probes decide */
#define BROKEN_PROMISES 3u /* a trust that ends as soon as it began counts as a third of that */
#define ACQUITTED_S 0.14f  /* and no longer than to here: fingers that hold a mode, and wires that mix, never show what is expected */

#define PROBE_FRAC 0.0015f /* of the mode's limit, that a probe moves it by in a tick: seven times the converters' noise */
#define HURRY_1_S 40.0f    /* of the limit, that these probes move a mode by in a second of one sign */
#define PROBES_MOST 0.5f   /* of the voltage */
#define PROBE_APART 3      /* bits from one mode's to the next's */

#define ALL_SENSORS ((1u << HD_MODES) - 1u)

static const hd_phasor_t ZERO = {0.0f, 0.0f};

void hd_trust_init(hd_core_t *core)
{
    float turns_hz = core->config.control_hz / (float)HD_MODES;
    core->probes = 0xB5297A4DU;
    core->trust_turns = (uint16_t)(1.0f + TRUST_S * turns_hz);
    core->renew_turns = (uint16_t)(1.0f + RENEW_S * turns_hz);
    core->settling_turns = (uint16_t)((SETTLING_TICKS + HD_MODES - 1) / HD_MODES);
    core->followed_ticks = (uint16_t)(1.0f + FOLLOWED_S * core->config.control_hz);
    core->patience_ticks = (uint16_t)(1.0f + PATIENCE_S * core->config.control_hz);
    core->acquitted_ticks = (uint16_t)(ACQUITTED_S * core->config.control_hz);
    core->sure_frac = hd_decay(-1.0f / (SURE_S * core->config.control_hz));
    core->missed_frac = hd_decay(-1.0f / (MEMORY_S * core->config.control_hz));
    float surprise_um = 0.0f;
    for (int k = 0; k < HD_MODES; k++) {
        surprise_um = fmaxf(surprise_um, SURPRISE_FRAC * core->config.w_limit_um[k]);
        core->hurry_um[k] = HURRY_1_S / core->config.control_hz * core->config.w_limit_um[k];
        core->probe_um[k] = PROBE_FRAC * core->config.w_limit_um[k];
    }
    core->surprise_um2 = surprise_um * surprise_um;
    hd_trust_none(core);
}

static void forget_answers(hd_reach_t *reach)
{
    reach->answers = 0;
    reach->contrary_um = reach->contrary_um2 = 0.0f;
}

static void doubt(hd_core_t *core, int s)
{
    hd_reach_t *reach = &core->reach[s];
    reach->trusted_turns = 0;
    reach->settling_turns = (uint8_t)core->settling_turns;
    reach->missed_um2 = reach->expected_um2 = 0.0f;
    forget_answers(reach);
    core->suspect = (uint8_t)(core->suspect | 1u << s);
}

void hd_trust_none(hd_core_t *core)
{
    core->trusted = 0;
    core->due = (uint8_t)ALL_SENSORS;
    core->follow_ticks = core->suspect_ticks = 0;
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        doubt(core, k);
    }
}

/* The voltage was steady until the tick just ended. */
static void begin_to_follow(hd_core_t *core)
{
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        hd_reach_t *reach = &core->reach[k];
        reach->shown_um = hd_scale(core->control.design.reach[k].push_um_per_v, core->control.loop[k].observer.old_v);
        reach->expected_um[0] = reach->expected_um[1] = ZERO;
        reach->missed_um2 = reach->expected_um2 = 0.0f;
    }
}

/* Whether a voltage changes enough for a sensor to show it. */
static bool changes(const hd_core_t *core)
{
    bool any = false;
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        const hd_observer_t *observer = &core->control.loop[k].observer;
        hd_phasor_t change_v = hd_sub(observer->new_v, observer->old_v);
        any = any || !hd_within(change_v, core->control.design.reach[k].change_v);
    }
    return any;
}

void hd_trust_follow(hd_core_t *core)
{
    if (core->due != 0 && (core->asks || changes(core))) {
        if (core->follow_ticks == 0) {
            begin_to_follow(core);
        }
        core->follow_ticks = core->followed_ticks;
    }
}

/* E of the tick whose innovation is known: the law has spoken once more since. */
static hd_phasor_t expect(hd_core_t *core, int k)
{
    hd_reach_t *reach = &core->reach[k];
    const hd_reach_design_t *design = &core->control.design.reach[k];
    const hd_observer_design_t *mode = &core->control.design.observer[k];
    const hd_observer_t *observer = &core->control.loop[k].observer;
    hd_phasor_t shown_um = hd_scale(design->newest_um_per_v, observer->new_v);
    shown_um = hd_add(shown_um, hd_scale(design->push_um_per_v - design->newest_um_per_v, observer->old_v));
    hd_phasor_t last_um = reach->expected_um[0];
    hd_phasor_t newest_um = hd_add(hd_sub(shown_um, reach->shown_um), hd_scale(mode->poles_sum, last_um));
    newest_um = hd_sub(newest_um, hd_scale(mode->poles_product, reach->expected_um[1]));
    reach->shown_um = shown_um;
    reach->expected_um[0] = newest_um;
    reach->expected_um[1] = last_um;
    return last_um;
}

/* Of the probes in the tick whose innovation is known, which saw two of them: -1 to 1. */
static float probed(const hd_core_t *core, int k)
{
    uint32_t bits = core->probes >> PROBE_APART * k;
    return (float)(int32_t)((bits & 1u) + (bits >> 1 & 1u)) - 1.0f;
}

/* What sensor s showed of the probes, against what they did. */
static inline void weigh(hd_core_t *core, int s, hd_phasor_t missed_um, hd_phasor_t expected_um)
{
    const hd_wires_t *wires = &core->control.design.wires;
    hd_reach_t *reach = &core->reach[s];
    hd_phasor_t sign = {probed(core, s), 0.0f};
    if (!wires->has_own_sensors) {
        sign = ZERO;
        #pragma GCC unroll 1
        for (int k = 0; k < HD_MODES; k++) {
            sign = hd_add(sign, hd_scale(probed(core, k), wires->sees[s][k]));
        }
    }
    float probed_um = hd_dot(sign, expected_um), shown_um = probed_um + hd_dot(sign, missed_um);
    reach->contrary_um = core->sure_frac * reach->contrary_um + CONTRARY * probed_um - shown_um;
    reach->contrary_um2 = core->sure_frac * reach->contrary_um2 + shown_um * shown_um;
    reach->answers = (uint8_t)(reach->answers + (reach->answers < ENOUGH ? 1 : 0));
}

/* By sensors that may each see several modes. */
void hd_trust_add_up(hd_core_t *core)
{
    const hd_wires_t *wires = &core->control.design.wires;
    float kept = core->missed_frac;
    uint32_t weighed = core->suspect_ticks > core->patience_ticks ? core->suspect : 0u;
    hd_phasor_t missed_um[HD_MODES], expected_um[HD_MODES];
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        missed_um[k] = core->control.loop[k].observer.innovation_um;
        expected_um[k] = expect(core, k);
    }
    #pragma GCC unroll 1
    for (int s = 0; s < HD_MODES; s++) {
        hd_reach_t *reach = &core->reach[s];
        hd_phasor_t i_um = missed_um[s], e_um = expected_um[s];
        if (!wires->has_own_sensors) {
            i_um = e_um = ZERO;
            #pragma GCC unroll 1
            for (int k = 0; k < HD_MODES; k++) {
                i_um = hd_add(i_um, hd_mul(wires->sees[s][k], missed_um[k]));
                e_um = hd_add(e_um, hd_mul(wires->sees[s][k], expected_um[k]));
            }
        }
        if ((weighed & 1u << s) != 0) {
            weigh(core, s, i_um, e_um);
        }
        reach->missed_um2 = kept * reach->missed_um2 + hd_dot(i_um, i_um);
        reach->expected_um2 = kept * reach->expected_um2 + hd_dot(e_um, e_um);
    }
}

bool hd_trust_shows(hd_core_t *core, int s)
{
    hd_reach_t *reach = &core->reach[s];
    bool settled = reach->settling_turns == 0;
    if (!(settled && reach->expected_um2 >= HD_LEAST_UM * HD_LEAST_UM && reach->missed_um2 <= MISSED2 * reach->expected_um2)) {
        return false;
    }
    reach->trusted_turns = core->trust_turns;
    reach->missed_um2 = reach->expected_um2 = 0.0f;
    forget_answers(reach);
    core->suspect = (uint8_t)(core->suspect & ~(1u << s));
    core->trusted = (uint8_t)(core->trusted | 1u << s);
    core->due = (uint8_t)(core->due & ~(1u << s));
    core->follow_ticks = core->due != 0 ? core->follow_ticks : 0;
    return true;
}

bool hd_trust_is_refuted(const hd_reach_t *reach)
{
    float contrary_um = reach->contrary_um;
    return reach->answers >= ENOUGH && contrary_um > 0.0f && contrary_um * contrary_um > SURE2 * reach->contrary_um2;
}

void hd_trust_judge(hd_core_t *core, int s)
{
    hd_reach_t *reach = &core->reach[s];
    uint32_t bit = 1u << s;
    if (reach->trusted_turns == 0) { /* not yet, or it has just ended */
        core->trusted = (uint8_t)(core->trusted & ~bit);
        core->due = (uint8_t)(core->due | bit);
        if (reach->settling_turns > 0) {
            reach->settling_turns--;
            reach->expected_um[0] = reach->expected_um[1] = ZERO; /* what is left of before, the couplings explain */
            reach->missed_um2 = reach->expected_um2 = 0.0f;
            forget_answers(reach);
        }
        hd_trust_shows(core, s);
        return;
    }
    reach->trusted_turns--;
    if (reach->trusted_turns <= core->renew_turns) {
        core->due = (uint8_t)(core->due | bit);
        if (hd_trust_shows(core, s)) {
            return;
        }
    }
    if (!(reach->missed_um2 <= SURPRISE2 * reach->expected_um2 + core->surprise_um2)) {
        if (2u * reach->trusted_turns > core->trust_turns && core->suspect_ticks < core->patience_ticks) {
            core->suspect_ticks = (uint16_t)(core->suspect_ticks + core->patience_ticks / BROKEN_PROMISES);
        }
        doubt(core, s);
        core->trusted = (uint8_t)(core->trusted & ~bit);
        core->due = (uint8_t)(core->due | bit);
    }
}

hd_phasor_t hd_trust_mixed_um(const hd_core_t *core, int s)
{
    const hd_wires_t *wires = &core->control.design.wires;
    hd_phasor_t sum_um = ZERO;
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        sum_um = hd_add(sum_um, hd_mul(wires->sees[s][k], core->control.loop[k].observer.innovation_um));
    }
    return sum_um;
}

void hd_trust_probe(hd_core_t *core)
{
    uint32_t bits = core->probes;
    core->control.probes = core->asks;
    core->probes = bits >> 1 | (bits ^ bits >> 10 ^ bits >> 30 ^ bits >> 31) << 31; /* comes round after 2^32 - 1 steps */
    bool hurries = core->suspect_ticks > core->patience_ticks;
    const float *probe_um = hurries ? core->hurry_um : core->probe_um;
    core->struck_tick = hurries ? core->sweep.ticks : core->struck_tick;
    float most_v = 0.0f, sum_v = 0.0f;
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        float probe_v = probe_um[k] * core->control.design.reach[k].v_per_um;
        core->control.probe_v[k] = (bits >> PROBE_APART * (k + 1) & 1u) != 0 ? probe_v : -probe_v;
        sum_v += probe_v;
        most_v = probe_v > most_v ? probe_v : most_v;
    }
    most_v = core->control.design.wires.has_own_amplifiers ? most_v : sum_v;
    float most_frac = most_v < PROBES_MOST * core->allowed_v ? most_v / core->allowed_v : PROBES_MOST;
    core->control.probe_frac = core->asks ? most_frac : 0.0f;
}
