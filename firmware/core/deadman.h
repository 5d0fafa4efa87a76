/* Dead-man timer of the host. A timeout disables the drive at once; only consecutive fresh references enable it. */
#ifndef HD_DEADMAN_H
#define HD_DEADMAN_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol.h"

#define HD_REPEATED_TRIPS 3
#define HD_REPEATED_US 10000000

typedef struct {
    uint32_t t_fed_us; /* time of the last reset of the timer; unused while `starving` */
    bool starving;
    uint8_t good_frames; /* references in a row, up to HD_REARM_FRAMES */
    uint16_t trips;
    uint32_t t_trip_us[HD_REPEATED_TRIPS]; /* oldest first */
    uint8_t recent_trips;
} hd_deadman_t;

/* As at boot, but keeps the count of trips. */
void hd_deadman_reset(hd_deadman_t *deadman);

void hd_deadman_good_reference(hd_deadman_t *deadman, uint32_t now_us);
void hd_deadman_good_keepalive(hd_deadman_t *deadman, uint32_t now_us);
void hd_deadman_bad_frame(hd_deadman_t *deadman);

/* To be called every tick: instants expire long before the clock wraps around to them. */
void hd_deadman_tick(hd_deadman_t *deadman, uint32_t now_us);

/* Counts a trip and restarts the count of good references. */
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
