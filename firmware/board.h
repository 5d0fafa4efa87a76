/* What a board provides to run the core on real hardware: a dozen calls, one implementation per folder under boards/.
 *
 * The program is the same everywhere (main.c): board_start, hd_init, board_run, then for ever read, hd_hear, hd_obey,
 * hd_say, write and sleep. The board's interrupt hands every chunk of samples to hd_on_chunk. The lock-step board
 * in boards/host needs none of this, for its caller holds the time.
 */
#ifndef HD_BOARD_H
#define HD_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "carrier.h"
#include "core.h"

/* Converters at mid-rail before anything else, then clocks, pins and link; amplifiers stay off. Fills in limits, rates,
 * the nominal plate, the boot id, the cause of the reset, and the log that survived it, if any. */
void board_start(hd_config_t *config, hd_converters_t *converters);

/* Lets samples flow: from now on the board's interrupt calls hd_on_chunk. */
void board_run(void);

/* Free-running microseconds, the instant that every call of the core is given. */
uint32_t board_now_us(void);

/* Bytes that came since the last call, 0 if none; never waits. */
size_t board_read(uint8_t *bytes, size_t capacity);

/* Room in the link's output, and a frame into it. */
size_t board_write_room(void);
void board_write(const uint8_t *bytes, size_t n);

/* Lets the amplifiers see the converters, or keeps them off. */
void board_enable_amplifiers(bool enable);

/* Keeps the chunk interrupt out while the main program is inside the core. */
void board_lock(void);
void board_unlock(void);

/* Sleeps until an interrupt. */
void board_wait(void);

/* From the control tick, and only if the main program has come round since the last time. */
void board_feed_watchdog(void);

/* Keeps the log where a reset leaves it, if the board has such memory. */
void board_keep_log(const hd_log_t *log);

/* main.c: a chunk was sampled into `in`; fill the one that will be played after the next. */
void hd_on_chunk(const uint16_t in[HD_CHUNK][HD_MODES], uint16_t out[HD_CHUNK][HD_MODES]);

/* main.c: samples were lost or a chunk was filled too late. The plate falls silent, and the host has to arm it anew. */
void hd_on_missed_chunk(void);

#endif
