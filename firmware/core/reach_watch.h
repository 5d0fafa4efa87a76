/* The core's part of reach.h: which voltage is allowed. */
#ifndef HD_REACH_WATCH_H
#define HD_REACH_WATCH_H

#include "core.h"

/* For a valid configuration. */
void hd_reach_init(hd_core_t *core);

/* Each tick, before the control law: what it and the observers last did, into `allowed_v` and the probes; or a fault. */
void hd_reach_watch(hd_core_t *core, uint32_t now_us);

#define HD_HURRY 4u /* 10 ms: of the time in which a sensor's trust is renewed */

/* A trusted sensor that does not answer small probes within that time is trusted no longer. */
void hd_reach_ask(hd_core_t *core, int s);

#endif
