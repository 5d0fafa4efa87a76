#include "reach_watch.h"

#include "states.h"
#include "trust.h"

#define REACH 1.25f        /* of the mode's limit: gains, noise and trust wrongly given carry a plate a fifth farther, below 1.6 */
#define APPROACH 0.25f     /* of what is left to there, a tick: all of it at once would make the voltage alternate */
#define MARGIN 1.15f       /* by which a trusted mode may be farther than it reads, as gains are known to a tenth */
#define ASK_FRAC 0.8f      /* of REACH: nearer the limit there is no time left for an answer */
#define SUSPECT_FRAC 0.02f /* of the mode's limit: a bound below needs no proof */

void hd_reach_init(hd_core_t *core)
{
    for (int k = 0; k < HD_MODES; k++) {
        core->suspect_um[k] = SUSPECT_FRAC * core->config.w_limit_um[k];
        core->ask_um[k] = ASK_FRAC * REACH * core->config.w_limit_um[k];
    }
    hd_trust_init(core);
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
        if ((design->sensors & core->due & 1u << s) != 0) {
            hd_trust_shows(core, s); /* its turn may come too late */
        }
    }
    if ((design->sensors & core->due) == 0) {
        return v_limit_v;
    }
    core->asks = true;
    if ((design->sensors & ~(uint32_t)core->trusted) == 0) {
        return v_limit_v;
    }
    float left_um = limit_um - core->reach[k].reach_um;
    float most_v = design->v_per_um * ((1.0f - design->kept) * limit_um + APPROACH * left_um);
    return most_v > 0.0f ? most_v : 0.0f;
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
        if (k == turn && (design->sensors & core->due) == 0) {
            reach_um = hd_smaller(reach_um, MARGIN * at_least(core->measured_um[k]));
        }
        reach_um += design->push_um_per_v * at_least(core->control.loop[k].observer.new_v);
        core->reach[k].reach_um = reach_um;
        suspect = suspect || (reach_um > core->suspect_um[k] && (design->sensors & core->suspect) != 0);
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
    hd_trust_follow(core);
    if (core->asks || asked) {
        hd_trust_probe(core);
    }
}

/* R was not followed: what sensors read bounds it, but modes measured by a doubted one may have gone to their limit. */
static __attribute__((noinline)) void bound_from_now(hd_core_t *core, uint32_t doubted)
{
    #pragma GCC unroll 1
    for (int k = 0; k < HD_MODES; k++) {
        float um = at_least(core->measured_um[k]), limit_um = core->config.w_limit_um[k];
        bool gone = (core->control.design.reach[k].sensors & doubted) != 0 && um < limit_um;
        core->reach[k].reach_um = MARGIN * (gone ? limit_um : um);
    }
}

/* Every sensor was trusted. */
static __attribute__((noinline)) void begin_to_bound(hd_core_t *core)
{
    #pragma GCC unroll 1
    for (int s = 0; s < HD_MODES; s++) {
        if (s == core->control.turn || !(core->reach[s].missed_um2 <= core->surprise_um2)) {
            hd_trust_judge(core, s);
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
        hd_trust_add_up(core);
    } else {
        hd_trust_listen(core, turn);
    }
    hd_trust_judge(core, turn);
    bound(core, turn);
    if (core->suspect_ticks > core->patience_ticks && hd_trust_is_refuted(&core->reach[turn])) {
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
    bool surprised = hd_trust_listen(core, turn);
    hd_reach_t *reach = &core->reach[turn];
    uint32_t left = reach->trusted_turns;
    reach->trusted_turns = (uint16_t)(left - 1u);
    if (left <= core->renew_turns || surprised) {
        begin_to_bound(core);
    }
}
