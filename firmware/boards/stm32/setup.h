/* What a laboratory sets: its plate, its amplifiers, its sensors and its clockwork. Measure, edit, build, flash.
 *
 * As it stands: the reference plate of the founding paper with Q = 500, with further modes near its two where a board
 * drives more, and a front end with which 150 V and 8 um fit the converters. Model and gains can be changed on the
 * running board too (SET_MODEL, SET_CONTROLLER); limits cannot. The crystal is in a board's registers.h.
 */
#ifndef HD_STM32_SETUP_H
#define HD_STM32_SETUP_H

#if HD_MODES == 2
#define PER_MODE(a, b, c, d, e, f, g, h) {a, b}
#elif HD_MODES == 3
#define PER_MODE(a, b, c, d, e, f, g, h) {a, b, c}
#elif HD_MODES == 4
#define PER_MODE(a, b, c, d, e, f, g, h) {a, b, c, d}
#elif HD_MODES == 5
#define PER_MODE(a, b, c, d, e, f, g, h) {a, b, c, d, e}
#else
#define PER_MODE(a, b, c, d, e, f, g, h) {a, b, c, d, e, f, g, h}
#endif
#define EACH_MODE(x) PER_MODE(x, x, x, x, x, x, x, x)
#define MODES_OF(of) PER_MODE(of(0), of(1), of(2), of(3), of(4), of(5), of(6), of(7))

#define LINK_BAUD 921600       /* at the start */
#define LINK_BAUD_MAX 3000000  /* that a host may ask for */
#ifndef CLOCK_AT_OSC_IN
#define CLOCK_AT_OSC_IN false /* true: a clock such as the ST-LINK's 8 MHz is there, instead of a crystal */
#endif
#define DRIVE_HZ 29205.0f

#ifndef CONTROL_HZ
#define CONTROL_HZ 5000 /* or 2000 */
#endif

/* Limits, applied independently of the host. */
#define V_LIMIT_V 150.0f
#define W_LIMIT_UM EACH_MODE(4.0f)

/* The plate: each mode's resonance, its quality factor, and what V_LIMIT_V hold at the drive frequency. */
#define MODE_HZ PER_MODE(29195.0f, 29215.0f, 29205.0f, 29255.0f, 29155.0f, 29105.0f, 29305.0f, 29375.0f)
#define QUALITY EACH_MODE(500.0f)
#define HELD_UM EACH_MODE(4.0f)

/* By how much amplifier, electrodes and sensor turn the phase back at the drive frequency, in rad. A sweep shows minus
 * the phase of the whole loop: take off the 0.184 rad (10.5 degrees) of the converters, which board.c adds by itself; on the
 * STM32H743 0.634, 0.519 or 0.404 rad, as CONVERTER_LAG_S has it. */
#define LOOP PER_MODE(LAG(0.0f), LAG(0.0f), LAG(0.0f), LAG(0.0f), LAG(0.0f), LAG(0.0f), LAG(0.0f), LAG(0.0f))

/* The wires, in SET_WIRING's words: rows of drive are amplifiers, of sense (real, imaginary) and feedthrough (um per V)
 * modes. Empty: amplifier and sensor k belong to mode k. Two amplifiers for sum and difference of two modes, as in the paper:
 * {.drive = {{0.5f, 0.5f}, {0.5f, -0.5f}}, .sense = {{{1.0f, 0.0f}, {0.0f, 0.0f}}, {{0.0f, 0.0f}, {1.0f, 0.0f}}}} */
#ifndef WIRING
#define WIRING {.drive = {{0.0f}}}
#endif

/* The converters' reference, and from their pins to the plate. With its buffer on, the DAC is linear to 0.2 V from
 * either rail (the STM32H743's AD5624 on 5 V to both): 1800 steps to each side of mid-rail. Gains are positive: what inverts is half a turn in LOOP. */
#define REFERENCE_V 3.3f
#define REFERENCE_TOLERANCE 0.03f /* of it: farther off by the internal reference, and the board does not drive */
#define DAC_STEPS 1800.0f
#define AMPLIFIER_V_PER_V EACH_MODE(110.0f)
#define SENSOR_UM_PER_V EACH_MODE(4.85f)

/* Between board and amplifiers. PB14 (no amplifier has a fault) and PB15 (the emergency stop is not pushed), on the
 * STM32G474 and the STM32H743 PC6 and PC7, are closed circuits to ground: a bench without such a contact has a wire bridge
 * there, or the board does not drive. */
#ifndef ENABLE_BY_PULSES
#define ENABLE_BY_PULSES true /* PB12 changes with every tick, for a retriggerable monostable; false: it is high to enable */
#endif

#define LATCH_REPEATED_TRIPS true /* three dead-man trips in ten seconds: a person should look */

_Static_assert(CONTROL_HZ == 2000 || CONTROL_HZ == 5000, "a tick is a whole number of chunks of 50 us");

#endif
