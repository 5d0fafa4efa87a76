/* A vibrating plate with fingers on it, seen as the slow envelopes of its modes in the rotating frame.
 *
 *   dW_p/dt = (-sigma_p + j delta_p) W_p - sum_q C_pq W_q - j sum_k g_pk e^(j theta_k) V_k,    C = sum_f c_f phi_f phi_f^T
 *
 * for P plate modes, K amplifiers and F touching fingers with modal shapes phi_f and contact loads c_f: the real part a
 * decay rate, the negative imaginary part a detuning. Sensors give S W, S complex. theta_k is all the constant phase of loop k, put where the drive acts. Double precision, Runge-Kutta of
 * order 4.
 *
 * Left out: the carrier itself (DAC and ADC quantisation, demodulation ripple), any
 * non-linearity of glass, glue and piezo, drift with temperature, and modes further from the drive than an envelope can
 * follow.
 */
#ifndef HD_PLATE_H
#define HD_PLATE_H

#include <complex.h>
#include <stdint.h>

#include "protocol.h"

#ifndef CMPLX /* clang, for which glibc leaves it out */
#define CMPLX(x, y) __builtin_complex((double)(x), (double)(y))
#endif

#define HD_PLATE_MODES_MAX 10 /* eight driven ones and two parasitic */
#define HD_STILL_UM 1e-100    /* less is 0: a plate that decays on into denormal numbers would take ten times as long */

typedef struct {
    int modes;
    double decay_1_s[HD_PLATE_MODES_MAX];
    double detuning_rad_s[HD_PLATE_MODES_MAX];
    double gain_um_per_v_s[HD_PLATE_MODES_MAX][HD_MODES];
    double complex loop[HD_MODES]; /* e^(j theta) */
    double complex sensor[HD_MODES][HD_PLATE_MODES_MAX];
    double complex through_um_per_v[HD_MODES][HD_MODES]; /* from amplifier to sensor, without the plate */
    double noise_um; /* standard deviation of each measured component, per tick */
    double amplifier_limit_v;

    double complex w_um[HD_PLATE_MODES_MAX];
    uint64_t random;
} hd_plate_t;

typedef struct {
    double rate_1_s[HD_PLATE_MODES_MAX][HD_PLATE_MODES_MAX];     /* real part of C */
    double detuning_rad_s[HD_PLATE_MODES_MAX][HD_PLATE_MODES_MAX]; /* negative imaginary part of C */
    double stiffest_1_s;                                         /* largest row sum of both parts' magnitudes */
    double detunes;                                              /* 0.0: no finger detunes */
} hd_contact_t;

/* Fingers as rows of phi (fingers, modes); a finger of decay 0 does not touch. `detuning_rad_s` may be NULL: none. */
hd_contact_t hd_plate_contact(const hd_plate_t *plate, int fingers, const double *phi, const double *decay_1_s,
                              const double *detuning_rad_s);

/* Moves the plate on by `span_s` under constant voltages; adds the integral of W over that time to `integral_um_s`. The
 * frame turns `frame_rad_s` faster than the one that the detunings are given for. */
void hd_plate_advance(hd_plate_t *plate, const hd_contact_t *contact, const double complex voltage_v[HD_MODES],
                      double frame_rad_s, double span_s, double complex integral_um_s[HD_PLATE_MODES_MAX]);

/* Two independent standard normal deviates at once, as a complex number. */
double complex hd_random_normal(uint64_t *state);

/* What the sensors make of a mean amplitude under a mean voltage, with noise. */
void hd_plate_measure(hd_plate_t *plate, const double complex mean_um[HD_PLATE_MODES_MAX],
                      const double complex mean_v[HD_MODES],
                      double complex measured_um[HD_MODES]);

#endif
