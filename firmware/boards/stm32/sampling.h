/* All converters at 1 MHz from one timer, in chunks, by DMA; and the pins besides: board_enable_amplifiers, board_interlock,
 * board_sync. board_lock keeps their interrupts out, which are in interrupts.c. */
#ifndef HD_STM32_SAMPLING_H
#define HD_STM32_SAMPLING_H

#include <stdbool.h>

#include "registers.h"
#include "setup.h"

#define BUSY 13 /* PB13, high while the interrupt works: its duty cycle is the load */
#define INTERLOCKS (1u << AMPLIFIER_FAULT | 1u << EMERGENCY_STOP) /* pins, and their EXTI lines too */

/* Without chunks the DACs would play the last 100 us for ever: the window watchdog (RM0090, 22; RM0440, 36) resets a chip
 * whose chunk interrupt does not end for 4 to 5 units of 96 or 98 us. Its clock is the core's, which CSS watches. */
static inline void sampling_feed_window_watchdog(void)
{
    WWDG->CR = WWDG_START | 4u;
}

static inline void sampling_show_busy(bool busy)
{
    GPIOB->BSRR = busy ? 1u << BUSY : 1u << (BUSY + 16);
}

/* Registers only, and any number of times: amplifiers off, all outputs at mid-rail. The first thing after a reset and
 * the last before one. */
void sampling_silence(void);

/* Lets samples flow and the interrupts come. */
void sampling_run(void);

/* From the beginning, after samples were lost. */
void sampling_restart(void);

/* VDDA has left its range while the board runs: board_interlock says so until a reset. */
void sampling_forbid_drive(void);

#endif
