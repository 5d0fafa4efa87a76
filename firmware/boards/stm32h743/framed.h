/* hd_carrier_listen and hd_carrier_speak for the STM32H743: samples as its three ADCs leave them, words as its two DACs take
 * them. The same sums, the same levels and the same state of the carrier, to the bit (tests/firmware/test_m4_bit_exact.py). */
#ifndef HD_H743_FRAMED_H
#define HD_H743_FRAMED_H

#include "carrier.h"

#define SENSORS_3 2 /* of ADC3; ADC1 and ADC2 have the other six */
#define CHIP_MODES 4

/* Of a chunk, in the order in which they are taken. */
typedef struct {
    uint16_t adc1[HD_CHUNK][3], adc2[HD_CHUNK][3], adc3[HD_CHUNK][SENSORS_3];
} sampled_t;

/* A DAC's words of a chunk: command and level, the last of each sample moves all four. */
typedef uint32_t words_t[HD_CHUNK][CHIP_MODES];

/* AD5624: 24 bits, 12 of data, left-aligned in 16. Into the input register of a DAC; with the fourth all four move; or into all
 * of them at once. */
#define WORD_STORE(dac) ((uint32_t)(dac) << 16)
#define WORD_STORE_4TH_AND_MOVE 0x130000u
#define WORD_MOVE_ALL 0x1F0000u
#define WORD_MID_RAIL (HD_MID_RAIL << 4)

bool framed_listen(hd_carrier_t *carrier, const sampled_t *in);
void framed_speak(hd_carrier_t *carrier, words_t *out[2]);

#endif
