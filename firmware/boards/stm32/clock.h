/* Clocks and the microsecond counter. */
#ifndef HD_STM32_CLOCK_H
#define HD_STM32_CLOCK_H

typedef enum {
    CLOCK_NONE,     /* not even the internal oscillator brings the PLL to lock */
    CLOCK_INTERNAL, /* the crystal does not start: 1 %, enough for the host link, not to drive a plate */
    CLOCK_CRYSTAL,
} clock_source_t;

/* Brings the core to CORE_HZ, and starts counting microseconds. Every wait is bounded: returns within 40 ms. */
clock_source_t clock_start(void);

#endif
