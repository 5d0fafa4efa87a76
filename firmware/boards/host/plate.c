#include "plate.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

/* Largest rate times step: the local error of order 4 is then below 1e-7 of the amplitude, far under the noise. */
#define STEP_RATE 0.1

hd_contact_t hd_plate_contact(const hd_plate_t *plate, int fingers, const double *phi, const double *decay_1_s,
                              const double *detuning_rad_s)
{
    hd_contact_t contact = {.stiffest_1_s = 0.0};
    for (int p = 0; p < plate->modes; p++) {
        double row = 0.0;
        for (int q = 0; q < plate->modes; q++) {
            for (int f = 0; f < fingers; f++) {
                const double *shape = phi + f * plate->modes;
                bool touches = decay_1_s[f] != 0.0; /* the shapes of an absent finger may be NaN */
                contact.rate_1_s[p][q] += touches ? decay_1_s[f] * shape[p] * shape[q] : 0.0;
                if (touches && detuning_rad_s != NULL) {
                    contact.detuning_rad_s[p][q] += detuning_rad_s[f] * shape[p] * shape[q];
                    contact.detunes += fabs(detuning_rad_s[f]);
                }
            }
            row += fabs(contact.rate_1_s[p][q]) + fabs(contact.detuning_rad_s[p][q]);
        }
        contact.stiffest_1_s = fmax(contact.stiffest_1_s, row);
    }
    return contact;
}

/* All that stays the same during an advance. */
typedef struct {
    const hd_plate_t *plate;
    const hd_contact_t *contact;
    double complex own_rate_1_s[HD_PLATE_MODES_MAX];
    double complex drive_um_s[HD_PLATE_MODES_MAX];
} motion_t;

static void slope(const motion_t *motion, const double complex *w_um, double complex *rate_um_s)
{
    for (int p = 0; p < motion->plate->modes; p++) {
        double complex rate = motion->drive_um_s[p] + motion->own_rate_1_s[p] * w_um[p];
        for (int q = 0; q < motion->plate->modes; q++) {
            rate -= motion->contact->rate_1_s[p][q] * w_um[q];
        }
        for (int q = 0; motion->contact->detunes != 0.0 && q < motion->plate->modes; q++) {
            rate += I * motion->contact->detuning_rad_s[p][q] * w_um[q];
        }
        rate_um_s[p] = rate;
    }
}

static void runge_kutta(hd_plate_t *plate, const motion_t *motion, double h, double complex *integral_um_s)
{
    static const double node[4] = {0.0, 0.5, 0.5, 1.0};
    static const double weight[4] = {1.0 / 6.0, 2.0 / 6.0, 2.0 / 6.0, 1.0 / 6.0};
    double complex rate[HD_PLATE_MODES_MAX] = {0}, stage[HD_PLATE_MODES_MAX], step[HD_PLATE_MODES_MAX] = {0};
    for (int s = 0; s < 4; s++) {
        for (int p = 0; p < plate->modes; p++) {
            stage[p] = plate->w_um[p] + h * node[s] * rate[p];
            integral_um_s[p] += h * weight[s] * stage[p]; /* the integral's own slope is W */
        }
        slope(motion, stage, rate);
        for (int p = 0; p < plate->modes; p++) {
            step[p] += h * weight[s] * rate[p];
        }
    }
    for (int p = 0; p < plate->modes; p++) {
        plate->w_um[p] += step[p];
        if (fabs(creal(plate->w_um[p])) + fabs(cimag(plate->w_um[p])) < HD_STILL_UM) {
            plate->w_um[p] = 0.0;
        }
    }
}

static double complex clipped(double complex voltage_v, double limit_v)
{
    double magnitude = cabs(voltage_v);
    return magnitude > limit_v ? voltage_v * (limit_v / magnitude) : voltage_v;
}

void hd_plate_advance(hd_plate_t *plate, const hd_contact_t *contact, const double complex voltage_v[HD_MODES],
                      double frame_rad_s, double span_s, double complex integral_um_s[HD_PLATE_MODES_MAX])
{
    motion_t motion = {.plate = plate, .contact = contact};
    double fastest_1_s = 0.0;
    for (int p = 0; p < plate->modes; p++) {
        motion.own_rate_1_s[p] = CMPLX(-plate->decay_1_s[p], plate->detuning_rad_s[p] - frame_rad_s);
        for (int k = 0; k < HD_MODES; k++) {
            double complex driving_v = plate->loop[k] * clipped(voltage_v[k], plate->amplifier_limit_v);
            motion.drive_um_s[p] -= I * plate->gain_um_per_v_s[p][k] * driving_v;
        }
        fastest_1_s = fmax(fastest_1_s, cabs(motion.own_rate_1_s[p]));
    }
    int steps = (int)ceil(span_s * (fastest_1_s + contact->stiffest_1_s) / STEP_RATE);
    steps = steps > 0 ? steps : 1;
    for (int i = 0; i < steps; i++) {
        runge_kutta(plate, &motion, span_s / steps, integral_um_s);
    }
}

/* splitmix64 (Steele, Lea and Flood, 2014). */
static uint64_t random_bits(uint64_t *state)
{
    uint64_t z = *state += 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

static double random_signed(uint64_t *state)
{
    return ((double)(random_bits(state) >> 11) + 0.5) * 0x1p-52 - 1.0; /* in (-1, 1) */
}

/* Marsaglia's polar method. */
double complex hd_random_normal(uint64_t *state)
{
    double x, y, r2;
    do {
        x = random_signed(state);
        y = random_signed(state);
        r2 = x * x + y * y;
    } while (r2 >= 1.0 || r2 == 0.0);
    return CMPLX(x, y) * sqrt(-2.0 * log(r2) / r2);
}

void hd_plate_measure(hd_plate_t *plate, const double complex mean_um[HD_PLATE_MODES_MAX],
                      const double complex mean_v[HD_MODES], double complex measured_um[HD_MODES])
{
    for (int k = 0; k < HD_MODES; k++) {
        measured_um[k] = plate->noise_um * hd_random_normal(&plate->random);
        for (int p = 0; p < plate->modes; p++) {
            measured_um[k] += plate->sensor[k][p] * mean_um[p];
        }
        for (int a = 0; a < HD_MODES; a++) {
            measured_um[k] += plate->through_um_per_v[k][a] * mean_v[a];
        }
    }
}
