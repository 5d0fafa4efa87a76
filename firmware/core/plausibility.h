/* Whether the plate as measured is what its drive does: sensors, wires and loops that cannot be believed. */
#ifndef HD_PLAUSIBILITY_H
#define HD_PLAUSIBILITY_H

#include "core.h"

void hd_plausibility_init(hd_core_t *core);
void hd_plausibility_reset(hd_core_t *core);

/* The fault of the first mode that has one, and which mode; once per tick, after the measurement. */
enum hd_fault hd_implausible(hd_core_t *core, int *mode);

#endif
