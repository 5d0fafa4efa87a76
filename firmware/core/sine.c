#include "sine.h"

/* cos(pi/2 x) = 1 + sum of C_n x^2n: Taylor's (-1)^n (pi/2)^2n / (2n)!. The first term left out is below 6e-13. */
#define C1 (-1.2337005501361698)
#define C2 0.25366950790104801
#define C3 (-0.020863480763352961)
#define C4 0.00091926027483942658
#define C5 (-0.000025202042373060605)
#define C6 4.7108747788181715e-7
#define C7 (-6.3866030837918522e-9)
#define C8 6.5659631149794724e-11

/* The table is made of constant expressions: every compiler evaluates them in the target's double precision, so it
 * needs no generator, and the rounding to integers leaves nothing in which two builds could differ. */
#define QUARTER (HD_SINE_ENTRIES / 4)
#define SQUARE(i) ((double)((i) * (i)) / ((double)QUARTER * QUARTER))
#define SERIES(y) (1.0 + y * (C1 + y * (C2 + y * (C3 + y * (C4 + y * (C5 + y * (C6 + y * (C7 + y * C8))))))))
#define COS(i) (int32_t)(SERIES(SQUARE(i)) * HD_SINE_ONE + 0.5)
#define SIN(i) COS(QUARTER - i)
#define PAIR(low, high) ((uint32_t)(uint16_t)(low) | (uint32_t)(uint16_t)(high) << 16),

/* cos and -sin in the four quarters of a turn, i entries after the quarter's beginning. */
#define FIRST(i) PAIR(COS(i), -SIN(i))
#define SECOND(i) PAIR(-SIN(i), -COS(i))
#define THIRD(i) PAIR(-COS(i), SIN(i))
#define FOURTH(i) PAIR(SIN(i), COS(i))

/* Counts from 00000 to 03777, in octal, digit by digit. */
#define DIGIT_3(f, i) f(i##0) f(i##1) f(i##2) f(i##3) f(i##4) f(i##5) f(i##6) f(i##7)
#define DIGIT_2(f, i) \
    DIGIT_3(f, i##0) DIGIT_3(f, i##1) DIGIT_3(f, i##2) DIGIT_3(f, i##3) \
    DIGIT_3(f, i##4) DIGIT_3(f, i##5) DIGIT_3(f, i##6) DIGIT_3(f, i##7)
#define DIGIT_1(f, i) \
    DIGIT_2(f, i##0) DIGIT_2(f, i##1) DIGIT_2(f, i##2) DIGIT_2(f, i##3) \
    DIGIT_2(f, i##4) DIGIT_2(f, i##5) DIGIT_2(f, i##6) DIGIT_2(f, i##7)
#define QUARTER_TURN(f) DIGIT_1(f, 00) DIGIT_1(f, 01) DIGIT_1(f, 02) DIGIT_1(f, 03)

_Static_assert(QUARTER == 04000, "four octal digits count a quarter");

const uint32_t hd_sine_table[HD_SINE_ENTRIES] = {
    QUARTER_TURN(FIRST) QUARTER_TURN(SECOND) QUARTER_TURN(THIRD) QUARTER_TURN(FOURTH)
};

/* cos(pi/2 x) for x = 0..1 in single precision: the same series, cut where it falls below 7e-9. */
static float cos_quarter(float x)
{
    float y = x * x;
    float tail = (float)C4 + y * ((float)C5 + y * (float)C6);
    return 1.0f + y * ((float)C1 + y * ((float)C2 + y * ((float)C3 + y * tail)));
}

static float cosine(uint32_t phase)
{
    const uint32_t quarter = 1u << 30;
    uint32_t angle = phase > 2u * quarter ? 0u - phase : phase; /* 0 to half a turn: the cosine is even */
    return angle > quarter ? -cos_quarter((float)(2u * quarter - angle) * 0x1p-30f)
                           : cos_quarter((float)angle * 0x1p-30f);
}

hd_phasor_t hd_unit_phasor(uint32_t phase)
{
    return (hd_phasor_t){cosine(phase), cosine(phase - (1u << 30))};
}
