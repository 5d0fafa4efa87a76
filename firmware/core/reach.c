#include "reach.h"

#include "exponential.h"
#include "reach_watch.h"
#include "states.h"

#define LEAST_DAMPING 0.5f /* of the model's, as plausibility.c has it */
#define REACH 1.25f        /* of the mode's limit: gains, noise and trust wrongly given carry a plate a fifth farther, below 1.6 */
#define APPROACH 0.25f     /* of what is left to there, a tick: all of it at once would make the voltage alternate */
#define LEAST_SENSE 0.2f   /* of a sensor in a mode: less of it that is wrong moves the mode by less than MISSED does */

#define MEMORY_S 0.005f    /* of the sums: ten ticks at 2 kHz, in which R comes to its limit from rest at full voltage */
#define FOLLOWED_S 0.01f   /* after a change of the voltage: the sums have forgotten it then */
#define MISSED2 0.11f      /* MISSED is a third: gains are known to a tenth, damped plates answer by another, half a signal is lost */
#define LEAST_UM 0.01f     /* that must have been expected, RMS over the sums: converters show a tenth of it */
#define MARGIN 1.15f       /* by which a trusted mode may be farther than it reads, as gains are known to a tenth */
#define TRUST_S 0.5f       /* a sensor that slowly loses its signal loses 2 % meanwhile */
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
#define HURRY_1_S 40.0f    /* of the limit, that these probes move a mode by in a second of one sign */

#define RENEW_S 0.04f      /* before the trust ends: long enough for an answer, so that nothing sound is ever held back */
#define ASK_FRAC 0.8f      /* of REACH: nearer the limit there is no time left for an answer */
#define PROBE_FRAC 0.0015f /* of the mode's limit, that a probe moves it by in a tick: seven times the converters' noise */
#define SUSPECT_FRAC 0.02f /* of the mode's limit: a bound below needs no proof */
#define PROBES_MOST 0.5f   /* of the voltage */
#define PROBE_APART 3      /* bits from one mode's to the next's */

#define ALL_SENSORS ((1u << HD_MODES) - 1u)

static const hd_phasor_t ZERO = {0.0f, 0.0f};

void hd_reach_design(hd_reach_design_t *design, const hd_observer_design_t *mode, const hd_phasor_t back[HD_MODES],
                     const hd_phasor_t sense[HD_MODES], float tick_s)
{
    float per_v = 0.0f;
    uint32_t hears = 0;
    for (int k = 0; k < HD_MODES; k++) {
        per_v += hd_magnitude(back[k]);
        hears |= hd_within(sense[k], LEAST_SENSE) ? 0u : 1u << k;
    }
    design->kept = hd_decay(-LEAST_DAMPING * mode->model.decay_1_s * tick_s);
    design->push_um_per_v = mode->model.gain_um_per_v_s * tick_s;
    design->newest_um_per_v = hd_magnitude(mode->mean_of_new_um_per_v);
    design->v_per_um = 1.0f / (design->push_um_per_v * per_v);
    design->change_v = LEAST_UM / design->push_um_per_v;
    design->hears = hears;
}

void hd_reach_init(hd_core_t *core)
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
    }
    core->surprise_um2 = surprise_um * surprise_um;
    for (int k = 0; k < HD_MODES; k++) {
        core->suspect_um[k] = SUSPECT_FRAC * core->config.w_limit_um[k];
        core->ask_um[k] = ASK_FRAC * REACH * core->config.w_limit_um[k];
        core->hurry_um[k] = HURRY_1_S / core->config.control_hz * core->config.w_limit_um[k];
        core->probe_um[k] = PROBE_FRAC * core->config.w_limit_um[k];
    }
    hd_reach_doubt(core);
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

void hd_reach_doubt(hd_core_t *core)
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
static __attribute__((noinline)) void add_up(hd_core_t *core)
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

/* Begins or renews a sensor's trust if it has shown what was expected. */
static bool shows(hd_core_t *core, int s)
{
    hd_reach_t *reach = &core->reach[s];
    bool settled = reach->settling_turns == 0;
    if (!(settled && reach->expected_um2 >= LEAST_UM * LEAST_UM && reach->missed_um2 <= MISSED2 * reach->expected_um2)) {
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

/* Whether probes surely moved the plate, and a sensor surely does not show it. */
static bool is_contrary(const hd_reach_t *reach)
{
    float contrary_um = reach->contrary_um;
    return reach->answers >= ENOUGH && contrary_um > 0.0f && contrary_um * contrary_um > SURE2 * reach->contrary_um2;
}

/* Whether the sensor's trust begins, goes on, or ends. */
static __attribute__((noinline)) void judge(hd_core_t *core, int s)
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
        shows(core, s);
        return;
    }
    reach->trusted_turns--;
    if (reach->trusted_turns <= core->renew_turns) {
        core->due = (uint8_t)(core->due | bit);
        if (shows(core, s)) {
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

/* What of the innovations a sensor brought. */
static __attribute__((noinline)) hd_phasor_t mixed_innovation_um(const hd_core_t *core, int s)
{
    const hd_wires_t *wires = &core->control.design.wires;
    hd_phasor_t sum_um = ZERO;
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        sum_um = hd_add(sum_um, hd_mul(wires->sees[s][k], core->control.loop[k].observer.innovation_um));
    }
    return sum_um;
}

/* Nothing is expected: what comes is a surprise. */
static inline bool listen(hd_core_t *core, int s)
{
    bool own = core->control.design.wires.has_own_sensors; /* (inlined, the other would have every tick save registers) */
    hd_phasor_t i_um = own ? core->control.loop[s].observer.innovation_um : mixed_innovation_um(core, s);
    core->reach[s].missed_um2 = core->missed_frac * core->reach[s].missed_um2 + hd_dot(i_um, i_um);
    return !(core->reach[s].missed_um2 <= core->surprise_um2);
}

/* To each sensor at every second tick at least: the observer follows a surprise within three. */
static inline bool listen_around(hd_core_t *core, int turn)
{
    bool surprised = listen(core, turn);
    #pragma GCC unroll 1
    for (int n = 2; n < HD_MODES; n += 2) {
        int s = turn + n < HD_MODES ? turn + n : turn + n - HD_MODES;
        surprised = listen(core, s) || surprised;
    }
    return surprised;
}

/* At least the magnitude, and at most 1.09 times that. */
static inline float at_least(hd_phasor_t value)
{
    float d = fabsf(value.d), q = fabsf(value.q);
    return d > q ? d + 0.4143f * q : q + 0.4143f * d;
}

/* The largest voltage that keeps a mode within reach; asks its sensors where they are not freshly trusted. */
static __attribute__((noinline)) float allowed_v(hd_core_t *core, int k)
{
    const hd_reach_design_t *design = &core->control.design.reach[k];
    float limit_um = REACH * core->config.w_limit_um[k], v_limit_v = core->config.v_limit_v;
    #pragma GCC unroll 1
    for (int s = 0; s < HD_MODES; s++) {
        if ((design->hears & core->due & 1u << s) != 0) {
            shows(core, s); /* its turn may come too late */
        }
    }
    if ((design->hears & core->due) == 0) {
        return v_limit_v;
    }
    core->asks = true;
    if ((design->hears & ~(uint32_t)core->trusted) == 0) {
        return v_limit_v;
    }
    float left_um = limit_um - core->reach[k].reach_um;
    float most_v = design->v_per_um * ((1.0f - design->kept) * limit_um + APPROACH * left_um);
    return most_v > 0.0f ? most_v : 0.0f;
}

static __attribute__((noinline)) void probe(hd_core_t *core)
{
    uint32_t bits = core->probes;
    core->control.probes = core->asks;
    core->probes = bits >> 1 | (bits ^ bits >> 10 ^ bits >> 30 ^ bits >> 31) << 31; /* comes round after 2^32 - 1 steps */
    const float *probe_um = core->suspect_ticks > core->patience_ticks ? core->hurry_um : core->probe_um;
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

static void follow(hd_core_t *core)
{
    if (core->due != 0 && (core->asks || changes(core))) {
        if (core->follow_ticks == 0) {
            begin_to_follow(core);
        }
        core->follow_ticks = core->followed_ticks;
    }
}

/* R, asks and limits, while a sensor is due. */
static __attribute__((noinline)) void bound(hd_core_t *core, int turn)
{
    bool asked = core->asks, suspect = false;
    float most_v = core->config.v_limit_v;
    core->asks = false;
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        const hd_reach_design_t *design = &core->control.design.reach[k];
        float reach_um = design->kept * core->reach[k].reach_um;
        if (k == turn && (design->hears & core->due) == 0) {
            reach_um = hd_smaller(reach_um, MARGIN * at_least(core->measured_um[k]));
        }
        reach_um += design->push_um_per_v * at_least(core->control.loop[k].observer.new_v);
        core->reach[k].reach_um = reach_um;
        suspect = suspect || (reach_um > core->suspect_um[k] && (design->hears & core->suspect) != 0);
        if (reach_um > core->ask_um[k]) {
            most_v = hd_smaller(most_v, allowed_v(core, k));
        }
    }
    core->suspect_ticks = suspect ? (uint16_t)(core->suspect_ticks + 1) : 0;
    if (core->suspect_ticks > core->acquitted_ticks) {
        core->suspect = 0;
        core->suspect_ticks = 0;
    }
    core->asks = core->asks || core->suspect_ticks > core->patience_ticks;
    if (core->due == 0) { /* the last of them has just shown it */
        most_v = core->config.v_limit_v;
        core->asks = false;
    }
    core->allowed_v = most_v;
    follow(core);
    if (core->asks || asked) {
        probe(core);
    }
}

/* R was not followed: what sensors read bounds it, but modes that hear a doubted one may have gone to their limit. */
static __attribute__((noinline)) void bound_from_now(hd_core_t *core, uint32_t doubted)
{
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        float um = at_least(core->measured_um[k]), limit_um = core->config.w_limit_um[k];
        bool gone = (core->control.design.reach[k].hears & doubted) != 0 && um < limit_um;
        core->reach[k].reach_um = MARGIN * (gone ? limit_um : um);
    }
}

/* Every sensor was trusted. */
static __attribute__((noinline)) void begin_to_bound(hd_core_t *core)
{
    #pragma GCC unroll 1
    for (int s = 0; s < HD_MODES; s++) {
        if (s == core->control.turn || !(core->reach[s].missed_um2 <= core->surprise_um2)) {
            judge(core, s);
        }
    }
    bound_from_now(core, ~(uint32_t)core->trusted);
}

void hd_reach_ask(hd_core_t *core, int s)
{
    uint32_t bit = 1u << s;
    if (core->due == 0) {
        bound_from_now(core, bit);
    }
    core->due = (uint8_t)(core->due | bit);
    uint16_t left = core->renew_turns / HD_HURRY, *turns = &core->reach[s].trusted_turns;
    *turns = *turns < left ? *turns : left;
}

/* While a sensor is due. */
static __attribute__((noinline)) void prove(hd_core_t *core, uint32_t now_us)
{
    int turn = core->control.turn;
    if (core->follow_ticks > 0) {
        core->follow_ticks--;
        add_up(core);
    } else {
        listen_around(core, turn);
    }
    judge(core, turn);
    bound(core, turn);
    if (core->suspect_ticks > core->patience_ticks && is_contrary(&core->reach[turn])) {
        hd_fail(core, HD_FAULT_NO_RESPONSE, turn, hd_magnitude(core->sensor_um[turn]), now_us);
    }
}

void hd_reach_watch(hd_core_t *core, uint32_t now_us)
{
    if (core->due != 0) {
        prove(core, now_us);
        return;
    }
    int turn = core->control.turn;
    bool surprised = listen_around(core, turn);
    hd_reach_t *reach = &core->reach[turn];
    uint32_t left = reach->trusted_turns;
    reach->trusted_turns = (uint16_t)(left - 1u);
    if (left <= core->renew_turns || surprised) {
        begin_to_bound(core);
    }
}
