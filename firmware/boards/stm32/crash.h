/* What no program comes back from: a fault of the processor, a crystal that stopped, a clock that never starts, a supply
 * that fails. */
#ifndef HD_STM32_CRASH_H
#define HD_STM32_CRASH_H

#include <stdint.h>

/* The vector of everything that should never happen: silence, a log entry with the place, a reset. */
void crash_handler(void);

/* The supply falls below 2.9 V. */
void crash_supply_handler(void);

/* The same for what the program itself cannot go on with. `value` goes into the log. */
_Noreturn void crash(uint8_t event, uint32_t value);

#endif
