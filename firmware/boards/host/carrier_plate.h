/* The same plate as plate.h, but as the converters meet it: real signals, sample by sample at HD_SAMPLE_HZ.
 *
 *   w_p'' + 2 sum_q (sigma_p [p = q] + C_pq) w_q' + Omega_p^2 w_p = 2 omega sum_k g_pk a_k,      lag a_k' = v_k - a_k
 *
 * for the plate modes w, amplifier outputs a and converter voltages v. The linear system is moved on exactly, by its
 * matrix exponential, while the converter holds its voltage. With w = Re(W e^{j omega t}) the rotating frame sees
 * plate.h's dW/dt, but for terms of the order sigma / omega (0.1 % of a change, nothing of what is held).
 *
 * Left out: what plate.h leaves out of fingers and materials; time jitter of the converters, their non-linearity and
 * settling; the anti-aliasing of a real front end.
 */
#ifndef HD_CARRIER_PLATE_H
#define HD_CARRIER_PLATE_H

#include <complex.h>

#include "carrier.h"
#include "plate.h"

#define HD_SIGNALS_MAX (2 * HD_PLATE_MODES_MAX + HD_MODES)

typedef struct {
    int modes;
    double drive_rad_s; /* that the gains and detunings are given for */
    double resonance_rad_s[HD_PLATE_MODES_MAX];
    double decay_1_s[HD_PLATE_MODES_MAX];
    double gain_um_per_v_s[HD_PLATE_MODES_MAX][HD_MODES];
    double sensor[HD_MODES][HD_PLATE_MODES_MAX];
    double amplifier_limit_v;
    double amplifier_lag_s; /* first order; 0 for none */

    double signal[HD_SIGNALS_MAX]; /* w of each mode, w' / omega of each mode, a of each amplifier */
    hd_contact_t contact;          /* what the two below were computed for */
    double step[HD_SIGNALS_MAX][HD_SIGNALS_MAX]; /* what each signal adds to all a sample later, */
    double kick[HD_MODES][HD_SIGNALS_MAX];       /* and each voltage */
} hd_carrier_plate_t;

/* Call it before the first sample, and whenever a finger may have moved. */
void hd_carrier_plate_touch(hd_carrier_plate_t *plate, const hd_contact_t *contact);

/* What the sensors show now. */
void hd_carrier_plate_sense(const hd_carrier_plate_t *plate, double sensed_um[HD_MODES]);

/* One sample on, with constant voltages at the amplifiers' inputs. */
void hd_carrier_plate_advance(hd_carrier_plate_t *plate, const double voltage_v[HD_MODES]);

/* The amplitude now, in the frame of an oscillator of `drive_rad_s` that stands at `phase`. */
double complex hd_carrier_plate_amplitude_um(const hd_carrier_plate_t *plate, int p, double drive_rad_s,
                                             uint32_t phase);

#endif
