/* Bounded waits for the hardware. */
#ifndef HD_STM32_WAIT_H
#define HD_STM32_WAIT_H

#include <stdbool.h>

#include "stm32.h"

/* Waits for (*reg & mask) == value, but not for ever: false after 20000 turns, 5 ms at 16 MHz. */
bool reaches(reg_t *reg, uint32_t mask, uint32_t value);

#endif
