/* Clocks and the microsecond counter. */
#ifndef HD_F405_CLOCK_H
#define HD_F405_CLOCK_H

#include <stdbool.h>

#define CORE_HZ 168000000
#define APB1_TIMER_HZ 84000000
#define APB2_HZ 84000000

typedef enum {
    CLOCK_NONE,     /* not even the internal oscillator brings the PLL to lock */
    CLOCK_INTERNAL, /* the crystal does not start: 1 %, enough for the host link, not to drive a plate */
    CLOCK_CRYSTAL,
} clock_source_t;

/* Brings the core to 168 MHz, and starts counting microseconds. Every wait is bounded: returns within 40 ms. */
clock_source_t clock_start(void);

#endif
