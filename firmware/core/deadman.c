#include "deadman.h"

static void forget_oldest_trip(hd_deadman_t *deadman)
{
    for (int i = 1; i < HD_REPEATED_TRIPS; i++) {
        deadman->t_trip_us[i - 1] = deadman->t_trip_us[i];
    }
    deadman->recent_trips = (uint8_t)((deadman->recent_trips < HD_REPEATED_TRIPS ? deadman->recent_trips : HD_REPEATED_TRIPS) - 1);
}

static void feed(hd_deadman_t *deadman, uint32_t now_us)
{
    deadman->t_fed_us = now_us;
    deadman->starving = false;
}

void hd_deadman_reset(hd_deadman_t *deadman)
{
    deadman->starving = true;
    deadman->good_frames = 0;
}

void hd_deadman_good_reference(hd_deadman_t *deadman, uint32_t now_us)
{
    feed(deadman, now_us);
    if (deadman->good_frames < HD_REARM_FRAMES) {
        deadman->good_frames++;
    }
}

void hd_deadman_good_keepalive(hd_deadman_t *deadman, uint32_t now_us)
{
    feed(deadman, now_us);
}

void hd_deadman_bad_frame(hd_deadman_t *deadman)
{
    deadman->good_frames = 0;
}

void hd_deadman_tick(hd_deadman_t *deadman, uint32_t now_us)
{
    /* Signed: a byte may have been taken in a little after the instant that the tick is given. */
    if (!deadman->starving && (int32_t)(now_us - deadman->t_fed_us) > HD_DEADMAN_US) {
        hd_deadman_reset(deadman);
    }
    while (deadman->recent_trips > 0 && now_us - deadman->t_trip_us[0] > HD_REPEATED_US) {
        forget_oldest_trip(deadman);
    }
}

void hd_deadman_trip(hd_deadman_t *deadman, uint32_t now_us)
{
    hd_deadman_reset(deadman);
    deadman->trips++;
    if (deadman->recent_trips >= HD_REPEATED_TRIPS) {
        forget_oldest_trip(deadman);
    }
    deadman->t_trip_us[deadman->recent_trips++] = now_us;
}
