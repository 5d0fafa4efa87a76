#include "tick.h"

#if TICK_CHUNKS_LATE > 0

#include "sampling.h"

static volatile bool under_way; /* from tick_begin to the end of the handler */
static bool is_void;            /* samples were lost meanwhile */
static int due_chunks;          /* until its voltages take effect; 0: they have */

/* A tick that is not over when the next one begins is a chunk lost. */
void tick_begin(void)
{
    if (under_way) {
        sampling_on_transfer_error();
        return;
    }
    hd_take_measurement();
    under_way = true;
    due_chunks = TICK_CHUNKS_LATE;
    SCB_ICSR = ICSR_PENDSVSET;
}

/* A tick that waited for the main loop's lock may be through a chunk later than usual. */
void tick_give(void)
{
    if (due_chunks > 1) {
        due_chunks--;
    } else if (due_chunks == 1 && !under_way) {
        due_chunks = 0;
        hd_give_voltage();
    }
}

void tick_lose_samples(void)
{
    due_chunks = 0;
    if (under_way) {
        is_void = true;
        hd_silence_output();
    } else {
        hd_on_missed_chunk();
    }
}

void sampling_on_tick(void)
{
    hd_on_measurement();
    board_lock();
    under_way = false;
    if (is_void) {
        is_void = false;
        hd_on_missed_chunk();
    }
    board_unlock();
}

#endif
