/* The control laws behind hd_control_step. Each writes u, in phase with what it drives, and the voltages that give it,
 * each within the limit; it returns true if the limit reduced it. The observers have been updated before. */
#ifndef HD_CONTROL_LAWS_H
#define HD_CONTROL_LAWS_H

#include "control.h"

bool hd_law_pi(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
               const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t u_v[HD_MODES],
               hd_phasor_t voltage_v[HD_MODES]);

bool hd_law_pi_ff(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES],
                  const hd_phasor_t measured_um[HD_MODES], float v_limit_v, hd_phasor_t u_v[HD_MODES],
               hd_phasor_t voltage_v[HD_MODES]);

bool hd_law_deadbeat(hd_control_t *control, const hd_phasor_t reference_um[HD_MODES], float v_limit_v,
                     hd_phasor_t u_v[HD_MODES], hd_phasor_t voltage_v[HD_MODES]);

#endif
