/* hd_carrier_listen and hd_carrier_speak for converters whose samples lie mode by mode: the same sums, the same words and
 * the same state of the carrier, to the bit (tests/firmware/test_m4_bit_exact.py), at half the cost for three modes. */
#ifndef HD_G474_PLANAR_H
#define HD_G474_PLANAR_H

#include "carrier.h"

#define PLANE (2 * HD_CHUNK) /* samples from one mode's to the next mode's */

/* The chunk of mode k begins at k * PLANE, word-aligned. */
bool planar_listen(hd_carrier_t *carrier, const uint16_t in[]);
void planar_speak(hd_carrier_t *carrier, uint16_t out[]);

#endif
