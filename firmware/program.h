/* What the interrupts of a board call of the program (main.c). */
#ifndef HD_PROGRAM_H
#define HD_PROGRAM_H

#include <stdbool.h>

#include "carrier.h"

/* The signal chain: the chunks' interrupt puts in what was sampled, and takes out what is to be played after the next. */
hd_carrier_t *hd_program_carrier(void);

/* A chunk completed the samples of a control tick. */
void hd_on_tick(void);

/* hd_on_tick in three calls, for a board whose ticks have an interrupt of their own, below the chunks': the first and the
 * last from the chunks' interrupt, the second from the tick's, and no two of them at a time. */
void hd_take_measurement(void);
void hd_on_measurement(void);
void hd_give_voltage(void);

/* Amplifiers off and zero voltage from the next chunk on; touches no state of the core's. */
void hd_silence_output(void);

/* Obeys board_interlock, at each tick and when the board is interrupted by it: quiet as long as it lasts, and afterwards
 * until the host's next consecutive references. True if it ended a drive. */
bool hd_on_interlock(void);

/* Samples were lost or a chunk was filled too late. The output goes to zero until the host arms the board again. */
void hd_on_missed_chunk(void);

#endif
