/* Whether the plate as measured is what its drive does: sensors, wires and loops that cannot be believed. */
#ifndef HD_PLAUSIBILITY_H
#define HD_PLAUSIBILITY_H

#include "core.h"

void hd_plausibility_init(hd_core_t *core);

/* The fault of the mode whose turn it is, if it has one; once per tick, after the measurement. */
enum hd_fault hd_implausible(hd_core_t *core);

#endif
