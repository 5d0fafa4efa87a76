/* When a control tick is computed: within the chunk's interrupt that completes its samples, or, where TICK_CHUNKS_LATE of
 * a chip's registers.h is above 0, in PendSV, which the chunks' interrupt interrupts; its voltages then take effect so many
 * chunks later, whenever it is through before.
 */
#ifndef HD_STM32_TICK_H
#define HD_STM32_TICK_H

#include <stdbool.h>

#include "program.h"
#include "registers.h"

#if TICK_CHUNKS_LATE > 0

#define VECTOR_TICK [14] = tick_handler,

/* In the chunks' interrupt: the samples of a tick are complete. */
void tick_begin(void);

/* A tick was not over when the next should have begun: that is a chunk lost. */
bool tick_overtaken(void);

/* In the chunks' interrupt, before tick_begin: hands on the voltages that are due. */
void tick_give(void);

/* Samples were lost. A tick under way is void, and tells the core of it at its end. */
void tick_lose_samples(void);

/* The handler of PendSV. */
void tick_handler(void);

#else

#define VECTOR_TICK

static inline void tick_begin(void)
{
    hd_on_tick();
}

static inline bool tick_overtaken(void)
{
    return false;
}

static inline void tick_give(void)
{
}

static inline void tick_lose_samples(void)
{
    hd_on_missed_chunk();
}

#endif

#endif
