#include "coupling.h"

#define LEAST_UM 0.1f

/* The row takes a step towards explaining d, with the tick's innovation as the newest part of it. What moves a mode
 * absurdly, or is not a number, is no coupling, and leaves nothing of the row. */
static void learn(hd_loop_t *loop, const hd_observer_design_t *design, const hd_phasor_t w_um[HD_MODES],
                  const hd_phasor_t step_1_um[HD_MODES], float power_um2)
{
    const hd_observer_t *observer = &loop->observer;
    hd_phasor_t *row_v_per_um = loop->coupling_v_per_um;
    hd_phasor_t cause_v = hd_add(observer->disturbance_v, hd_scale(design->newest_v_per_um, observer->innovation_um));
    hd_phasor_t error_v = hd_sub(cause_v, hd_row(row_v_per_um, w_um));
    bool sane = hd_dot(error_v, error_v) <= design->absurd_v2_per_um2 * power_um2;
    for (int q = 0; q < HD_MODES; q++) {
        row_v_per_um[q] = sane ? hd_add(row_v_per_um[q], hd_mul(error_v, step_1_um[q])) : (hd_phasor_t){0.0f, 0.0f};
    }
}

void hd_couple(hd_control_t *control)
{
    hd_phasor_t w_um[HD_MODES], moved_um[HD_MODES], step_1_um[HD_MODES];
    float power_um2 = 0.0f;
    for (int k = 0; k < HD_MODES; k++) {
        const hd_observer_t *observer = &control->loop[k].observer;
        w_um[k] = observer->before_um;
        moved_um[k] = hd_sub(observer->w_um, observer->before_um);
        power_um2 += hd_dot(w_um[k], w_um[k]);
    }
    bool learns = power_um2 > LEAST_UM * LEAST_UM && power_um2 <= FLT_MAX;
    if (learns) {
        control->coupling_um2 = control->design.coupling_memory_frac * control->coupling_um2 + power_um2;
        float step_1_um2 = 1.0f / control->coupling_um2;
        for (int q = 0; q < HD_MODES; q++) {
            step_1_um[q] = hd_scale(step_1_um2, hd_conj(w_um[q]));
        }
    }
    for (int k = 0; k < HD_MODES; k++) {
        hd_loop_t *loop = &control->loop[k];
        if (learns) {
            learn(loop, &control->design.observer[k], w_um, step_1_um, power_um2);
        }
        hd_observer_t *observer = &loop->observer;
        observer->disturbance_v = hd_add(observer->disturbance_v, hd_row(loop->coupling_v_per_um, moved_um));
    }
}
