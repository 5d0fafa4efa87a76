/* Which sensors are trusted: those that have shown what changes of the voltage did (reach.h), and the probes that ask them. */
#ifndef HD_TRUST_H
#define HD_TRUST_H

#include "core.h"

/* For a valid configuration. */
void hd_trust_init(hd_core_t *core);

/* Trusts no sensor. */
void hd_trust_none(hd_core_t *core);

/* Where the voltage changes enough for a sensor to show it, follows for a while what is expected of that. */
void hd_trust_follow(hd_core_t *core);

/* The tick's innovations and what was expected of them, into the sums of each sensor, while that is followed. */
void hd_trust_add_up(hd_core_t *core);

/* Begins or renews a sensor's trust if it has shown what was expected. */
bool hd_trust_shows(hd_core_t *core, int s);

/* Whether the sensor's trust begins, goes on, or ends. */
void hd_trust_judge(hd_core_t *core, int s);

/* Whether probes surely moved the plate, and a sensor surely does not show it. */
bool hd_trust_is_refuted(const hd_reach_t *sensor);

/* What of the innovations a sensor brought, where wires mix. */
hd_phasor_t hd_trust_mixed_um(const hd_core_t *core, int s);

/* The next small random steps of the modes' drives, or none. */
void hd_trust_probe(hd_core_t *core);

/* Nothing is expected: what comes is a surprise. */
static inline bool hd_trust_listen_to(hd_core_t *core, int s)
{
    bool own = core->control.design.wires.has_own_sensors; /* (inlined, the other would have every tick save registers) */
    hd_phasor_t i_um = own ? core->control.loop[s].observer.innovation_um : hd_trust_mixed_um(core, s);
    core->reach[s].missed_um2 = core->missed_frac * core->reach[s].missed_um2 + hd_dot(i_um, i_um);
    return !(core->reach[s].missed_um2 <= core->surprise_um2);
}

/* To each sensor at every second tick at least: the observer follows a surprise within three. */
static inline bool hd_trust_listen(hd_core_t *core, int turn)
{
    bool surprised = hd_trust_listen_to(core, turn);
    #pragma GCC unroll 1
    for (int n = 2; n < HD_MODES; n += 2) {
        int s = turn + n < HD_MODES ? turn + n : turn + n - HD_MODES;
        surprised = hd_trust_listen_to(core, s) || surprised;
    }
    return surprised;
}

#endif
