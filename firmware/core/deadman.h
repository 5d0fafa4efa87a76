/* Whether the host is still there. Silence drops the trust at once; only a run of fresh references restores it. */
#ifndef HD_DEADMAN_H
#define HD_DEADMAN_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol.h"

#define HD_REPEATED_TRIPS 3
#define HD_REPEATED_US 10000000

typedef struct {
    uint32_t t_fed_us; /* last sign of life; means nothing while `starving` */
    bool starving;
    uint8_t good_frames; /* references in a row, up to HD_REARM_FRAMES */
    uint16_t trips;
    uint32_t t_trip_us[HD_REPEATED_TRIPS]; /* oldest first */
    uint8_t recent_trips;
} hd_deadman_t;

/* As at boot, but the trips stay counted. */
void hd_deadman_reset(hd_deadman_t *deadman);

void hd_deadman_good_reference(hd_deadman_t *deadman, uint32_t now_us);
void hd_deadman_good_keepalive(hd_deadman_t *deadman, uint32_t now_us);
void hd_deadman_bad_frame(hd_deadman_t *deadman);

/* To be called every tick: instants are forgotten long before the clock wraps around to them. */
void hd_deadman_tick(hd_deadman_t *deadman, uint32_t now_us);

/* Counts a trip; the run of good references starts anew. */
void hd_deadman_trip(hd_deadman_t *deadman, uint32_t now_us);

static inline bool hd_deadman_armed(const hd_deadman_t *deadman)
{
    return !deadman->starving && deadman->good_frames >= HD_REARM_FRAMES;
}

static inline bool hd_deadman_repeated(const hd_deadman_t *deadman)
{
    return deadman->recent_trips >= HD_REPEATED_TRIPS;
}

#endif
