/* Handlers of what comes while the program runs; those of its end are in crash.h, that of a tick in tick.h. */
#ifndef HD_STM32_INTERRUPTS_H
#define HD_STM32_INTERRUPTS_H

/* A chunk was sampled. */
void on_chunk(void);

/* A stream has stopped with an error. */
void on_transfer_error(void);

/* A circuit of board_interlock has opened. */
void on_interlock(void);

#endif
