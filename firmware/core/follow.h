/* The drive follows the plate: a plate that warms drifts by some Hz a minute, all modes together, and a drive that stays
 * behind loses reach. Every 100 ms the drive moves by a small share of the mean detuning that the observers have learned
 * meanwhile, so that it settles in seconds; without a jump in phase, only by what modes have shown that move, and within
 * a reach of the frequency that it was set to. The models are those in the drive's frame: they move along with it.
 */
#ifndef HD_FOLLOW_H
#define HD_FOLLOW_H

#include "control.h"

#define HD_TURN_RAD 6.2831853f

typedef struct {
    float base_hz;  /* set */
    float reach_hz; /* to either side; 0: the drive stays */
    float drive_hz; /* followed */
    uint16_t period_ticks;
    uint16_t ticks;
} hd_follower_t;

void hd_follow_init(hd_follower_t *follower, float drive_hz, float control_hz);

/* The drive from now on. */
void hd_follow_set(hd_follower_t *follower, float base_hz, float reach_hz);

/* Once in each control tick in which references drive the plate: true if the drive may move. */
static inline bool hd_follow_due(hd_follower_t *follower)
{
    return ++follower->ticks >= follower->period_ticks;
}

/* Moves the drive. */
void hd_follow_step(hd_follower_t *follower, hd_control_t *control);

#endif
