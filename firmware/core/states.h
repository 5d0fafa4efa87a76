/* The board's states: what enters and leaves them, with its entry in the log. */
#ifndef HD_STATES_H
#define HD_STATES_H

#include "core.h"

#define HD_ALL_MODES 255 /* in the log: no single one is concerned */

/* Another state is reported at once. */
void hd_enter(hd_core_t *core, enum hd_state state);

/* Silence until the fault is cleared. `value` is the measurement, where there is one; `mode` may be HD_ALL_MODES. */
void hd_fail(hd_core_t *core, enum hd_fault fault, int mode, float value, uint32_t now_us);

/* Once a tick: the dead-man's timeout, and when references may drive. */
void hd_watch_host(hd_core_t *core, uint32_t now_us);

#endif
