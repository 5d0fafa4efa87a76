/* What each chip does in a way of its own, in its folder's chip.c; the rest of the program is the same on all of them. */
#ifndef HD_STM32_CHIP_H
#define HD_STM32_CHIP_H

#include <stdbool.h>

#include "carrier.h"
#include "registers.h"

/* Lets the locked PLL clock the core, at the speed of clock.h. */
bool chip_use_pll(void);

/* Registers only, in any state of the chip: all outputs at mid-rail, without a trigger. */
void converters_silence(void);

/* From silence: the streams, the DACs and the ADCs wait for TIM2. */
void converters_start(void);

/* Ends the streams and resets DACs, ADCs and TIM2. */
void converters_stop(void);

/* All streams are where they should be relative to each other, and nothing was lost. */
bool converters_in_step(void);

/* hd_carrier_listen and hd_carrier_speak for the half that was sampled, and for the half that is played after the next. */
bool converters_listen(hd_carrier_t *carrier, int half);
void converters_speak(hd_carrier_t *carrier, int half);

/* Readings of the internal reference, as VREFINT_CALIBRATION is one, 0 if none comes: between start and stop, and before
 * converters_start, whose ADC it takes. */
void reference_start(void);
float reference_reading(void);
void reference_stop(void);

/* One while the converters run, where REFERENCE_IS_WATCHED, and begins the next; 0 if none is through. */
uint32_t reference_glance(void);

/* Pins, baud rate and stream routes of the host's line; link.c starts the streams. */
void serial_start(void);

/* Another speed of that line; false while its last byte is not out. */
bool serial_set_baud(uint32_t baud);

/* Brown-out reset below 2.7 V at least, by the option bytes. */
bool chip_guards_brown_out(void);

/* Watches the supply: false if it stays below 2.9 V; falling later raises EXTI line 16. */
bool chip_watch_supply(void);

#endif
