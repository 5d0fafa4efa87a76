#include "memory.h"

#include <stddef.h>

#include "core.h"
#include "sine.h"

#define PIECE 16U /* words */
#define WORDS(begin, end) ((uint32_t)(((end) - (begin)) / sizeof(uint32_t)))
#define DESIGN_WORDS WORDS(0, sizeof(hd_design_t))
#define SETTLED_WORDS WORDS(offsetof(hd_core_t, settled), offsetof(hd_core_t, config.log))
#define REFERENCE_ROUNDING 1.00001f /* of a knot that was brought within its limit, and of interpolation */

_Static_assert(sizeof(hd_design_t) % sizeof(uint32_t) == 0, "a design is whole words");
_Static_assert(offsetof(hd_core_t, control.design) % sizeof(uint32_t) == 0, "a design lies on whole words");
_Static_assert((offsetof(hd_core_t, config.log) - offsetof(hd_core_t, settled)) % sizeof(uint32_t) == 0, "whole words");

uint32_t hd_sum_words(const void *begin, uint32_t n)
{
    const hd_word_t *word = begin, *end = word + n;
    uint32_t sum = 0;
    for (; end - word >= 4; word += 4) {
        uint32_t a = word[0], b = word[1], c = word[2], d = word[3]; /* loads one after the other cost half */
        __asm("" : "+r"(a), "+r"(b), "+r"(c), "+r"(d));
        sum += a + b + c + d;
    }
    #pragma GCC unroll 1
    while (word != end) {
        sum += *word++;
    }
    return sum;
}

void hd_memory_init(hd_core_t *core)
{
    hd_settled_t *settled = &core->settled;
    settled->v_limit_inverted = hd_inverted(core->config.v_limit_v);
    for (int k = 0; k < HD_MODES; k++) {
        float limit_um = REFERENCE_ROUNDING * core->config.w_limit_um[k];
        settled->w_limit_um2[k] = limit_um * limit_um;
    }
    settled->table_sum = hd_sum_words(hd_sine_table, HD_SINE_ENTRIES);
    settled->balance = 0u;
    settled->balance = 0u - hd_sum_words(settled, SETTLED_WORDS);
    hd_memory_restart(core);
}

void hd_memory_restart(hd_core_t *core)
{
    core->sweep.constants = 0;
    core->sweep.constants_sum = 0u;
}

/* Design and what is settled, one after the other. */
static bool constants_agree(hd_core_t *core)
{
    hd_sweep_t *sweep = &core->sweep;
    uint32_t at = sweep->constants, end = at < DESIGN_WORDS ? DESIGN_WORDS : DESIGN_WORDS + SETTLED_WORDS;
    const hd_word_t *word = at < DESIGN_WORDS ? (const hd_word_t *)&core->control.design + at
                                              : (const hd_word_t *)&core->settled + (at - DESIGN_WORDS);
    uint32_t left = end - at;
    if (at >= end) { /* the count itself */
        return false;
    }
    left = left > PIECE ? PIECE : left;
    sweep->constants_sum += hd_sum_words(word, left);
    sweep->constants = (uint16_t)(at + left);
    bool agree = true;
    if (sweep->constants == DESIGN_WORDS + SETTLED_WORDS) {
        agree = sweep->constants_sum == 0u;
        hd_memory_restart(core);
    }
    return agree;
}

static bool table_agrees(hd_core_t *core)
{
    hd_sweep_t *sweep = &core->sweep;
    uint32_t at = sweep->table % HD_SINE_ENTRIES;
    uint32_t sum = (at == 0 ? 0u : sweep->table_sum) + hd_sum_words(hd_sine_table + at, PIECE);
    sweep->table = (uint16_t)(at + PIECE);
    sweep->table_sum = sum;
    return at + PIECE < HD_SINE_ENTRIES || sum == core->settled.table_sum;
}

enum hd_damage hd_memory_sweep(hd_core_t *core)
{
    if ((core->sweep.ticks & 8u) == 0) {
        return constants_agree(core) ? HD_DAMAGE_NONE : HD_DAMAGE_CONSTANTS;
    }
    return table_agrees(core) ? HD_DAMAGE_NONE : HD_DAMAGE_TABLE;
}
