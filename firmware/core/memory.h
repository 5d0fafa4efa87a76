/* Is what the core computes with still what it was given? A bit of a RAM turns over now and then, and an output limit that
 * did would be none.
 *
 * Limits are kept twice: at every tick that of the voltage is compared with its inverse, and the reference of the mode whose
 * turn it is with the square of the limit that it was brought within when it came. The rest is added up, slowly: design,
 * configuration and what else is settled at the start by turns with the sine table, 16 words in every eighth tick, and the
 * carrier's scales (carrier.h) whole in every eighth. Whatever does not agree is HD_FAULT_MEMORY, and stays so until a reset.
 */
#ifndef HD_MEMORY_H
#define HD_MEMORY_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol.h"

/* What a fault HD_FAULT_MEMORY notes as its value. */
enum hd_damage {
    HD_DAMAGE_NONE = 0,
    HD_DAMAGE_VOLTAGE_LIMIT = 1,
    HD_DAMAGE_REFERENCE = 2, /* or the limit of one */
    HD_DAMAGE_CONSTANTS = 3, /* the controller's design, or the configuration */
    HD_DAMAGE_TABLE = 4,
    HD_DAMAGE_CARRIER = 5,
};

/* How far the sums have come. */
typedef struct {
    uint32_t ticks;
    uint32_t constants_sum, table_sum;
    uint16_t constants, table; /* words */
} hd_sweep_t;

/* What stands for what is settled at the start. */
typedef struct {
    uint32_t v_limit_inverted; /* bit by bit */
    float w_limit_um2[HD_MODES]; /* squared, with room for roundings */
    uint32_t table_sum;
    uint32_t balance; /* brings the sum of all that is settled to 0 */
} hd_settled_t;

typedef uint32_t __attribute__((may_alias)) hd_word_t;

static inline uint32_t hd_inverted(float value)
{
    uint32_t bits;
    __builtin_memcpy(&bits, &value, sizeof bits);
    return ~bits;
}

/* The sum of so many words, modulo 2^32: a turned bit cannot leave it as it was. */
uint32_t hd_sum_words(const void *begin, uint32_t n);

/* One tick of eight is the carrier's. */
static inline bool hd_sweeps_carrier(const hd_sweep_t *sweep)
{
    return (sweep->ticks & 7u) == 0;
}

/* Another one is the constants' and the table's, by turns. */
static inline bool hd_sweeps_core(const hd_sweep_t *sweep)
{
    return (sweep->ticks & 7u) == 4u;
}

#endif
