#include "reach.h"

#include "exponential.h"

#define LEAST_DAMPING 0.5f /* of the model's, as plausibility.c has it */
#define LEAST_SENSE 0.2f   /* of a sensor in a mode: less of it that is wrong moves the mode by less than MISSED does */

void hd_reach_design(hd_reach_design_t *design, const hd_observer_design_t *mode, const hd_phasor_t back[HD_MODES],
                     const hd_phasor_t sense[HD_MODES], float tick_s)
{
    float per_v = 0.0f;
    uint32_t sensors = 0;
    for (int k = 0; k < HD_MODES; k++) {
        per_v += hd_magnitude(back[k]);
        sensors |= hd_within(sense[k], LEAST_SENSE) ? 0u : 1u << k;
    }
    design->kept = hd_decay(-LEAST_DAMPING * mode->model.decay_1_s * tick_s);
    design->push_um_per_v = mode->model.gain_um_per_v_s * tick_s;
    design->newest_um_per_v = hd_magnitude(mode->mean_of_new_um_per_v);
    design->v_per_um = 1.0f / (design->push_um_per_v * per_v);
    design->change_v = HD_LEAST_UM / design->push_um_per_v;
    design->sensors = sensors;
}
