/* What a board provides to run the core on real hardware: a dozen calls, one implementation per folder under boards/.
 *
 * The program is the same everywhere (main.c): board_start, hd_init, board_run, then in a loop read, hd_hear, hd_obey,
 * hd_say, write and sleep. Interrupts call the program by program.h, never a board: calls go one way, from the interrupts to
 * the program, the board, its drivers and the registers (tests/firmware/test_layers.py). The lock-step board in boards/host
 * needs none of this, as its caller controls the time.
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

/* Starts sampling: from now on the interrupts come. */
void board_run(void);

/* Free-running microseconds, the instant that every call of the core is given. */
uint32_t board_now_us(void);

/* Bytes received since the last call, 0 if none; never blocks. */
size_t board_read(uint8_t *bytes, size_t capacity);

/* Room in the link's output, and a frame into it. */
size_t board_write_room(void);
void board_write(const uint8_t *bytes, size_t n);

/* Gives the line another speed, 0 for the one of the start; false as long as it still sends. */
bool board_set_baud(uint32_t baud);

/* What a board's log has besides enum hd_event. */
enum hd_board_event {
    HD_EVENT_IMAGE = 96, /* the program in the flash is damaged: the board does not drive */
    HD_EVENT_BROWN_OUT_OFF = 97,
        /* the chip's brown-out reset is off: the board does not drive; run `make -C firmware protect` */
    HD_EVENT_SUPPLY = 98,          /* the supply fell below 2.9 V */
    HD_EVENT_AMPLIFIER_FAULT = 99,
        /* an amplifier reported a fault: PB14, on the STM32G474 and the STM32H743 PC6, is open. A bench without such a contact
         * has a wire from there to ground */
    HD_EVENT_EMERGENCY_STOP = 100,
        /* emergency stop: PB15, on the STM32G474 and the STM32H743 PC7, is open. A bench without such a contact has a wire from
         * there to ground */
    HD_EVENT_REFERENCE = 101,
        /* the converters' supply VDDA is not 3.3 V: the board does not drive. `value` is what the chip's internal reference
         * shows at the start, in V; 0: it drifted while the STM32G474 ran, which watches it. 3 % are allowed, as it scales
         * voltages and amplitudes together */
};

/* Enables or disables the amplifiers, at every control tick. */
void board_enable_amplifiers(bool enable);

/* The sync output, at every control tick. */
void board_sync(bool high);

/* The event that forbids to drive now, such as an emergency stop; 0 if there is none. */
uint8_t board_interlock(void);

/* Masks the chunk interrupt while the main program is inside the core. */
void board_lock(void);
void board_unlock(void);

/* Sleeps until an interrupt. */
void board_wait(void);

/* Called by the control tick, only if the main loop has completed a round since the last call. */
void board_feed_watchdog(void);

/* Stores the log in memory that survives a reset, if the board has any. */
void board_keep_log(const hd_log_t *log);

#endif
