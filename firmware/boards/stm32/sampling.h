/* All converters at 1 MHz from one timer, in chunks, by DMA; and the pins between them and the amplifiers. */
#ifndef HD_STM32_SAMPLING_H
#define HD_STM32_SAMPLING_H

#include <stdbool.h>
#include <stdint.h>

/* Registers only, and any number of times: amplifiers off, all outputs at mid-rail. The first thing after a reset and
 * the last before one. */
void sampling_silence(void);

/* Lets samples flow and the interrupts come. */
void sampling_run(void);

void sampling_enable_amplifiers(bool enable);

/* The event that forbids to drive, by the pins; 0 if there is none. */
uint8_t sampling_interlock(void);

/* Keeps the chunk interrupt out. */
void sampling_lock(void);
void sampling_unlock(void);

/* Handlers: a chunk was sampled, or a stream has stopped with an error. */
void sampling_on_chunk(void);
void sampling_on_transfer_error(void);

#endif
