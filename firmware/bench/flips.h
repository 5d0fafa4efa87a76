/* One bit of the program's memory turns over, once, while it drives the plate. */
#ifndef AN_FLIPS_H
#define AN_FLIPS_H

#include <stddef.h>

#include "analog.h"
#include "carrier.h"
#include "core.h"

typedef struct {
    uint8_t *byte; /* where; NULL: no bit of this case turns over */
    uint8_t mask;
    const char *what; /* region */
    ptrdiff_t at;     /* byte of it */
} an_flip_t;

/* A bit of what a tick computes with, of the carrier, of the whole core, or of the sine table. */
an_flip_t an_draw_flip(an_random_t *random, hd_core_t *core, hd_carrier_t *carrier);

/* Turns it over: in the table as in a board's RAM, though the host's is read-only. */
void an_turn_over(const an_flip_t *flip);

/* As it was, for the next case. */
void an_mend(const an_flip_t *flip);

#endif
