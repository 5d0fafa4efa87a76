#include "wait.h"

/* Turns of a loop that takes at least 4 cycles at 16 MHz: 5 ms, twice what a crystal needs. */
#define WAIT_TURNS 20000

bool reaches(reg_t *reg, uint32_t mask, uint32_t value)
{
    for (int turn = 0; turn < WAIT_TURNS; turn++) {
        if ((*reg & mask) == value) {
            return true;
        }
    }
    return false;
}
