#include "tick.h"

#include "board.h"

#if TICK_CHUNKS_LATE > 0

static volatile bool under_way; /* from tick_begin to the end of the handler */
static bool is_void;            /* samples were lost meanwhile */
static bool overtaken;          /* by the next, which was not begun */
static int due_chunks;          /* until its voltages take effect; 0: they have */

void tick_begin(void)
{
    if (under_way) {
        overtaken = true;
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

bool tick_overtaken(void)
{
    return overtaken;
}

void tick_lose_samples(void)
{
    due_chunks = 0;
    overtaken = false;
    if (under_way) {
        is_void = true;
        hd_silence_output();
    } else {
        hd_on_missed_chunk();
    }
}

void tick_handler(void)
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
