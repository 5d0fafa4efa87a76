#include "interrupts.h"

#include "board.h"
#include "chip.h"
#include "program.h"
#include "sampling.h"
#include "tick.h"

/* (Inlined, it would have every chunk save more registers.) */
static __attribute__((noinline)) void restart(void)
{
    tick_lose_samples();
    sampling_restart();
}

static inline void exchange(int half)
{
    hd_carrier_t *carrier = hd_program_carrier();
    bool is_tick = converters_listen(carrier, half);
    tick_give();
    if (is_tick) {
        tick_begin();
    }
    converters_speak(carrier, half);
}

void on_chunk(void)
{
    sampling_show_busy(true);
    uint32_t event = CHUNK_FLAGS & (CHUNK_HALF | CHUNK_COMPLETE | CHUNK_ERROR);
    CHUNK_CLEAR = event; /* and not what comes between the two: that would be a chunk lost unseen */
    if ((event == CHUNK_HALF || event == CHUNK_COMPLETE) && converters_in_step()) {
        exchange(event == CHUNK_COMPLETE);
    } else {
        event = 0;
    }
    /* The other half's event now would mean that the DACs play what was just being filled. */
    if (event == 0 || tick_overtaken() || (CHUNK_FLAGS & (CHUNK_HALF | CHUNK_COMPLETE)) != 0) {
        restart();
    }
    sampling_feed_window_watchdog();
    sampling_show_busy(false);
}

/* What opened for less than it takes to come here was none. Mid-rail now, not after the 100 us that the buffers hold. */
void on_interlock(void)
{
    EXTI->PR = INTERLOCKS;
    board_lock();
    if (hd_on_interlock()) {
        sampling_restart();
    }
    board_unlock();
}

void on_transfer_error(void)
{
    restart();
}
