#include "control_laws.h"
#include "governor.h"

/* u over the coming hold that leaves the trajectory where it is and a share p of the distance to it:
 * a W^ + b (u + d) = (1 - p) x + p W^. */
static hd_phasor_t staying_v(const hd_loop_t *loop, const hd_observer_design_t *design, float pole)
{
    const hd_observer_t *observer = &loop->observer;
    hd_phasor_t kept = {pole - design->keep.d, -design->keep.q};
    hd_phasor_t step_um = hd_add(hd_scale(1.0f - pole, loop->x_um[0]), hd_mul(kept, observer->w_um));
    return hd_sub(hd_mul(step_um, design->push_v_per_um), observer->disturbance_v);
}

/* Factor that brings the references to where the amplifiers can hold the plate as it has turned out to be. */
static float holdable_fraction(const hd_control_t *control, const hd_phasor_t reference_um[HD_MODES], float v_limit_v)
{
    hd_phasor_t goal_v[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        goal_v[k] = hd_observer_holding_v(&control->loop[k].observer, &control->design.observer[k], reference_um[k]);
    }
    return hd_holdable_fraction(&control->design.wires, goal_v, v_limit_v);
}

bool hd_law_deadbeat(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES], float v_limit_v,
                     hd_phasor_t u_v[HD_MODES], hd_phasor_t voltage_v[HD_MODES])
{
    float holdable = holdable_fraction(control, reference_um, v_limit_v);
    hd_phasor_t goal_um[HD_MODES], stay_v[HD_MODES], move_v[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        const hd_loop_t *loop = &control->loop[k];
        const hd_observer_design_t *design = &control->design.observer[k];
        goal_um[k] = hd_scale(holdable, reference_um[k]);
        stay_v[k] = staying_v(loop, design, control->design.pole);
        move_v[k] = hd_mul(hd_sub(goal_um[k], loop->x_um[0]), design->push_v_per_um);
    }
    float fraction = hd_feasible_fraction(&control->design.wires, stay_v, move_v, v_limit_v);
    bool saturated = fraction < 1.0f || holdable < 1.0f;
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t *x_um = &control->loop[k].x_um[0];
        *x_um = hd_on_the_way(*x_um, goal_um[k], fraction);
        u_v[k] = hd_add(stay_v[k], hd_scale(fraction, move_v[k]));
    }
    return hd_wiring_drive(&control->design.wires, u_v, v_limit_v, voltage_v) || saturated;
}
