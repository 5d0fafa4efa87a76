/* What a board provides to run the core on real hardware: a dozen calls, one implementation per folder under boards/.
 *
 * The main program of a board is the same everywhere: hd_init with board_config, then for ever read, hd_receive,
 * hd_transmit, write, and sleep; the control interrupt does board_measure, hd_tick, board_drive. The lock-step board in
 * boards/host needs none of this, for its caller holds the time.
 */
#ifndef HD_BOARD_H
#define HD_BOARD_H

#include <stddef.h>
#include <stdint.h>

#include "core.h"

/* Clocks, pins, converters and link; amplifiers stay off. Fills in limits, rates, the nominal plate and the boot id. */
void board_start(hd_config_t *config);

/* Free-running microseconds, the instant that every call of the core is given. */
uint32_t board_now_us(void);

/* Bytes that came since the last call, 0 if none; never waits. */
size_t board_read(uint8_t *bytes, size_t capacity);

/* Room in the link's output, and whole frames into it. */
size_t board_write_room(void);
void board_write(const uint8_t *bytes, size_t n);

/* From the control interrupt: mean amplitudes over the tick just ended, demodulated as w(t) = W_d cos(wt) - W_q
 * sin(wt). */
void board_measure(hd_phasor_t measured_um[HD_MODES]);

/* From the control interrupt: voltages to synthesise v(t) = V_d cos(wt) - V_q sin(wt), from the next chunk on. */
void board_drive(const hd_phasor_t voltage_v[HD_MODES]);

/* Lets the amplifiers see the converters, or ties them to mid-rail. */
void board_enable_amplifiers(bool enable);

/* Keeps the control interrupt out while the main program is inside the core. */
void board_lock(void);
void board_unlock(void);

/* Sleeps until an interrupt. */
void board_wait(void);

/* To be called from the control interrupt, and only if the main program has come round since the last time. */
void board_feed_watchdog(void);

#endif
