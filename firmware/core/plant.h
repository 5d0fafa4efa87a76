/* The board's model of one mode of the plate, in the rotating frame:
 *
 *   dW/dt = (-decay + j detuning) W + gain u,   u = -j loop V
 */
#ifndef HD_PLANT_H
#define HD_PLANT_H

#include "phasor.h"
#include "protocol.h"
#include "wiring.h"

typedef struct {
    float decay_1_s;
    float detuning_rad_s;
    float gain_um_per_v_s;
    hd_phasor_t loop; /* unit phasor of the loop's constant phase: what goes out is turned back by it; (1, 0) for none */
} hd_mode_model_t;

typedef struct {
    hd_mode_model_t model[HD_MODES];
    hd_wiring_t wiring;
    float tick_s;
    float output_delay_frac; /* of a tick, from the call to the voltage on the plate */
} hd_plant_t;

#endif
