/* Both converters at 1 MHz from one timer, in chunks, by DMA. */
#ifndef HD_F405_SAMPLING_H
#define HD_F405_SAMPLING_H

#include <stdbool.h>

/* Registers only, and any number of times: amplifiers off, both outputs at mid-rail. The first thing after a reset and
 * the last before one. */
void sampling_silence(void);

/* Lets samples flow and the interrupt come. */
void sampling_run(void);

void sampling_enable_amplifiers(bool enable);

/* Keeps the chunk interrupt out. */
void sampling_lock(void);
void sampling_unlock(void);

#endif
