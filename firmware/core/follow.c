#include "follow.h"

#define PERIOD_S 0.1f
#define SHARE 0.025f       /* of the detuning, each period: a time constant of 4 s */
#define STEP_MAX_HZ 0.4f   /* each period: what is learned of a finger in passing moves the drive by little */
#define LEARNED_FRAC 0.25f /* of the period: a mode that moved for less says nothing */

void hd_follow_init(hd_follower_t *follower, float drive_hz, float control_hz)
{
    follower->period_ticks = (uint16_t)(control_hz * PERIOD_S);
    hd_follow_set(follower, drive_hz, HD_FOLLOW_HZ);
}

void hd_follow_set(hd_follower_t *follower, float base_hz, float reach_hz)
{
    follower->base_hz = follower->drive_hz = base_hz;
    follower->reach_hz = reach_hz;
    follower->ticks = 0;
}

static float clamped(float value, float limit)
{
    return fminf(fmaxf(value, -limit), limit);
}

/* Mean over the modes that have moved, in rad/s from their models. */
static float learned_detuning_rad_s(hd_control_t *control, float least_turns)
{
    float sum_rad_s = 0.0f, modes = 0.0f;
    for (int k = 0; k < HD_MODES; k++) {
        hd_observer_t *observer = &control->loop[k].observer;
        if ((float)observer->learned_turns >= least_turns) {
            sum_rad_s += control->design.plant.model[k].gain_um_per_v_s * observer->change_v_per_um.q;
            modes += 1.0f;
        }
        observer->learned_turns = 0;
    }
    return modes > 0.0f ? sum_rad_s / modes : 0.0f;
}

static void move(hd_follower_t *follower, hd_control_t *control, float step_hz)
{
    float offset_hz = clamped(follower->drive_hz - follower->base_hz + step_hz, follower->reach_hz);
    float before_hz = follower->drive_hz;
    follower->drive_hz = follower->base_hz + offset_hz;
    float faster_rad_s = HD_TURN_RAD * (follower->drive_hz - before_hz);
    for (int k = 0; k < HD_MODES; k++) {
        hd_observer_turn(&control->loop[k].observer, &control->design.observer[k], faster_rad_s);
        control->loop[k].coupling_v_per_um[k].q -= control->design.observer[k].v_per_um_s * faster_rad_s;
    }
}

void hd_follow_step(hd_follower_t *follower, hd_control_t *control)
{
    follower->ticks = 0;
    float least_turns = LEARNED_FRAC / (float)HD_MODES * (float)follower->period_ticks;
    float detuning_hz = learned_detuning_rad_s(control, least_turns) / HD_TURN_RAD;
    move(follower, control, clamped(SHARE * detuning_hz, STEP_MAX_HZ));
}
