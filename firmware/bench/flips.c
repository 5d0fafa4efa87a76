#define _DEFAULT_SOURCE /* sysconf and mprotect */
#include "flips.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "sine.h"

typedef struct {
    const char *name;
    void *begin;
    size_t size;
    int share; /* in hundredths */
} region_t;

an_flip_t an_draw_flip(an_random_t *random, hd_core_t *core, hd_carrier_t *carrier)
{
    const region_t regions[] = {
        {"tick", core, offsetof(hd_core_t, has_seq), 40},
        {"carrier", carrier, sizeof *carrier, 25},
        {"core", core, sizeof *core, 25},
        {"table", (void *)(uintptr_t)hd_sine_table, sizeof hd_sine_table, 10},
    };
    int hundredth = an_below(random, 100);
    const region_t *region = regions;
    while (hundredth >= region->share) {
        hundredth -= region->share;
        region++;
    }
    size_t at = (size_t)an_below(random, (int)region->size);
    return (an_flip_t){(uint8_t *)region->begin + at, (uint8_t)(1u << an_below(random, 8)), region->name, (ptrdiff_t)at};
}

void an_turn_over(const an_flip_t *flip)
{
    uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE), begin = (uintptr_t)flip->byte / page * page;
    if (mprotect((void *)begin, page, PROT_READ | PROT_WRITE) != 0) {
        perror("mprotect");
        exit(1);
    }
    *flip->byte ^= flip->mask;
}

void an_mend(const an_flip_t *flip)
{
    *flip->byte ^= flip->mask;
}
