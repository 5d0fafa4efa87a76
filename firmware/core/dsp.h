/* Arithmetic on the two signed 16-bit halves of a word: one instruction each on a Cortex-M4, and elsewhere the same in
 * plain C, wrapping where the instruction wraps. */
#ifndef HD_DSP_H
#define HD_DSP_H

#include <stdint.h>

#if defined(__ARM_FEATURE_DSP) && defined(__ARM_FEATURE_SIMD32)
#define HD_DSP_INSTRUCTIONS 1
#include <arm_acle.h>
#else
#define HD_DSP_INSTRUCTIONS 0
#endif

static inline int32_t hd_low_half(uint32_t pair)
{
    return (int16_t)(pair & 0xFFFFu);
}

static inline int32_t hd_high_half(uint32_t pair)
{
    return (int16_t)(pair >> 16);
}

static inline uint32_t hd_pair(int32_t low, int32_t high)
{
    return ((uint32_t)low & 0xFFFFu) | (uint32_t)high << 16;
}

/* Two halfwords of memory as one word. (By the built-in copy: -ffreestanding would make it a call of memcpy.) */
static inline uint32_t hd_load_pair(const uint16_t halves[2])
{
    uint32_t pair;
    __builtin_memcpy(&pair, halves, sizeof pair);
    return pair;
}

static inline void hd_store_pair(uint16_t halves[2], uint32_t pair)
{
    __builtin_memcpy(halves, &pair, sizeof pair);
}

/* The lower half of `low >> shift` below the upper half of `high`; the shift is a constant. */
static inline uint32_t hd_pack(uint32_t high, uint32_t low, const int shift)
{
#if HD_DSP_INSTRUCTIONS
    uint32_t pair;
    __asm("pkhtb %0, %1, %2, asr %3" : "=r"(pair) : "r"(high), "r"(low), "I"(shift));
    return pair;
#else
    return (high & 0xFFFF0000u) | (low >> shift & 0xFFFFu);
#endif
}

/* a - b, half by half */
static inline uint32_t hd_subtract_halves(uint32_t a, uint32_t b)
{
#if HD_DSP_INSTRUCTIONS
    return (uint32_t)__ssub16((int16x2_t)a, (int16x2_t)b);
#else
    return hd_pair(hd_low_half(a) - hd_low_half(b), hd_high_half(a) - hd_high_half(b));
#endif
}

#define HD_WRAPPING_ADD(sum, product) (int32_t)((uint32_t)(sum) + (uint32_t)(product))

/* sum + a.low b.low + a.high b.high */
static inline int32_t hd_add_products(int32_t sum, uint32_t a, uint32_t b)
{
#if HD_DSP_INSTRUCTIONS
    return __smlad((int16x2_t)a, (int16x2_t)b, sum);
#else
    int32_t low = hd_low_half(a) * hd_low_half(b);
    return HD_WRAPPING_ADD(HD_WRAPPING_ADD(sum, low), hd_high_half(a) * hd_high_half(b));
#endif
}

/* sum + one half of a times one half of b */
#if HD_DSP_INSTRUCTIONS
#define HD_ADD_PRODUCT(name, instruction, a_half, b_half) \
    static inline int32_t name(int32_t sum, uint32_t a, uint32_t b) \
    { \
        return instruction((int32_t)a, (int32_t)b, sum); \
    }
#else
#define HD_ADD_PRODUCT(name, instruction, a_half, b_half) \
    static inline int32_t name(int32_t sum, uint32_t a, uint32_t b) \
    { \
        return HD_WRAPPING_ADD(sum, a_half(a) * b_half(b)); \
    }
#endif

HD_ADD_PRODUCT(hd_add_low_low, __smlabb, hd_low_half, hd_low_half)
HD_ADD_PRODUCT(hd_add_low_high, __smlabt, hd_low_half, hd_high_half)
HD_ADD_PRODUCT(hd_add_high_low, __smlatb, hd_high_half, hd_low_half)
HD_ADD_PRODUCT(hd_add_high_high, __smlatt, hd_high_half, hd_high_half)

#endif
