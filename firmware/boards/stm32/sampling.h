/* All converters at 1 MHz from one timer, in chunks, by DMA; and the pins besides: board_enable_amplifiers, board_interlock,
 * board_sync. board_lock keeps their interrupt out. */
#ifndef HD_STM32_SAMPLING_H
#define HD_STM32_SAMPLING_H

/* Registers only, and any number of times: amplifiers off, all outputs at mid-rail. The first thing after a reset and
 * the last before one. */
void sampling_silence(void);

/* Lets samples flow and the interrupts come. */
void sampling_run(void);

/* VDDA has left its range while the board runs: board_interlock says so until a reset. */
void sampling_forbid_drive(void);

/* Handlers: a chunk was sampled, a stream has stopped with an error, a circuit of board_interlock has opened. */
void sampling_on_chunk(void);
void sampling_on_transfer_error(void);
void sampling_on_interlock(void);

#endif
