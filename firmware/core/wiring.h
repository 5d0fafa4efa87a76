/* Between modes and wires: amplifiers may each drive several modes, sensors may each see several.
 *
 *   W = sense y - feedthrough V      amplitudes of the modes, from the sensors y and the amplifiers' voltages V
 *   V_k = sum_p j conj(loop_p) drive_kp u_p
 *
 * `drive` is real: the amplifiers differ by sign and share, the loop's phase belongs to the mode. Feedthrough is what a
 * voltage adds to a measurement without moving the mode: electrical crosstalk and the static response of other modes.
 * The voltage limit holds for each amplifier, so that modes which share one share its voltage.
 */
#ifndef HD_WIRING_H
#define HD_WIRING_H

#include "phasor.h"
#include "protocol.h"

typedef struct {
    float drive[HD_MODES][HD_MODES];                    /* of amplifier k, by mode p */
    hd_phasor_t sense[HD_MODES][HD_MODES];              /* of mode p, by sensor s */
    hd_phasor_t feedthrough_um_per_v[HD_MODES][HD_MODES]; /* of mode p, by amplifier k */
} hd_wiring_t;

/* What a tick needs of the wiring: the drive matrix with the loops' phases in it, its inverse, and what may be left
 * out. */
typedef struct {
    hd_phasor_t out[HD_MODES][HD_MODES];  /* V_k of u_p */
    hd_phasor_t back[HD_MODES][HD_MODES]; /* u_p of V_k */
    hd_phasor_t sees[HD_MODES][HD_MODES]; /* sensor s of W_p; 0 if the sensors cannot tell the modes apart */
    uint8_t shares[HD_MODES];             /* amplifiers with a part worth counting in mode p, one bit each */
    bool has_own_amplifiers;              /* each mode has one that drives no other */
    bool has_own_sensors;                 /* as they are, without feedthrough */
} hd_wires_t;

/* The wiring of a setup that names none: amplifier and sensor k belong to mode k. */
void hd_wiring_complete(hd_wiring_t *wiring);

/* False if a number is out of bounds, or if the amplifiers cannot drive the modes independently. */
bool hd_wiring_valid(const hd_wiring_t *wiring);

/* For a valid wiring and unit phasors of the modes' loops. */
void hd_wiring_design(hd_wires_t *wires, const hd_wiring_t *wiring, const hd_phasor_t loop[HD_MODES]);

/* sum over n of row[n] value[n] */
static inline hd_phasor_t hd_row(const hd_phasor_t row[HD_MODES], const hd_phasor_t value[HD_MODES])
{
    hd_phasor_t sum = hd_mul(row[0], value[0]);
    for (int n = 1; n < HD_MODES; n++) {
        sum = hd_add(sum, hd_mul(row[n], value[n]));
    }
    return sum;
}

/* The amplifiers' voltages for these u up to their phases: in `mixed_v`, or u itself. */
static inline const hd_phasor_t *hd_wiring_loads_v(const hd_wires_t *wires, const hd_phasor_t u_v[HD_MODES],
                                                   hd_phasor_t mixed_v[HD_MODES])
{
    if (wires->has_own_amplifiers) {
        return u_v;
    }
    for (int k = 0; k < HD_MODES; k++) {
        mixed_v[k] = hd_row(wires->out[k], u_v);
    }
    return mixed_v;
}

/* The modes' amplitudes from what the sensors measured while the amplifiers had these mean voltages. */
void hd_wiring_sense(const hd_wiring_t *wiring, const hd_phasor_t sensor_um[HD_MODES],
                     const hd_phasor_t mean_v[HD_MODES], hd_phasor_t mode_um[HD_MODES]);

/* The amplifiers' voltages, each within the limit. `u_v` becomes what they then do to the modes; true if the limit
 * reduced one. */
bool hd_wiring_drive(const hd_wires_t *wires, hd_phasor_t u_v[HD_MODES], float v_limit_v,
                     hd_phasor_t voltage_v[HD_MODES]);

#endif
