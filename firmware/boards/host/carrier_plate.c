#include "carrier_plate.h"

#include <math.h>
#include <string.h>

#define SAMPLE_S (1.0 / HD_SAMPLE_HZ)
#define NEGLIGIBLE 1e-18 /* a term of the exponential that no longer changes a double near 1 */
#define TERMS_MAX 100

typedef struct {
    double rate[HD_SIGNALS_MAX][HD_SIGNALS_MAX + HD_MODES]; /* signal' = rate (signal, voltage) */
    int signals;
} generator_t;

static int signal_count(const hd_carrier_plate_t *plate)
{
    return 2 * plate->modes + HD_MODES;
}

static generator_t generator(const hd_carrier_plate_t *plate)
{
    const int modes = plate->modes, n = signal_count(plate);
    generator_t g = {.signals = n};
    bool lags = plate->amplifier_lag_s > 0.0;
    for (int p = 0; p < modes; p++) {
        double *speed = g.rate[modes + p];
        g.rate[p][modes + p] = plate->drive_rad_s;
        speed[p] = -plate->resonance_rad_s[p] * plate->resonance_rad_s[p] / plate->drive_rad_s;
        speed[modes + p] = -2.0 * plate->decay_1_s[p];
        for (int q = 0; q < modes; q++) {
            speed[modes + q] -= 2.0 * plate->contact.rate_1_s[p][q];
        }
        for (int k = 0; k < HD_MODES; k++) {
            speed[(lags ? 2 * modes : n) + k] = 2.0 * plate->gain_um_per_v_s[p][k];
        }
    }
    for (int k = 0; lags && k < HD_MODES; k++) {
        g.rate[2 * modes + k][2 * modes + k] = -1.0 / plate->amplifier_lag_s;
        g.rate[2 * modes + k][n + k] = 1.0 / plate->amplifier_lag_s;
    }
    return g;
}

/* term := term * rate * factor, for a term of `signals` rows; the voltages are held, so their own rate is 0. Returns the
 * largest element. */
static double next_term(const generator_t *g, double factor, double term[HD_SIGNALS_MAX][HD_SIGNALS_MAX + HD_MODES])
{
    const int n = g->signals, columns = n + HD_MODES;
    double largest = 0.0;
    for (int i = 0; i < n; i++) {
        double row[HD_SIGNALS_MAX + HD_MODES] = {0};
        for (int j = 0; j < n; j++) {
            for (int c = 0; c < columns; c++) {
                row[c] += factor * term[i][j] * g->rate[j][c];
            }
        }
        for (int c = 0; c < columns; c++) {
            term[i][c] = row[c];
            largest = fmax(largest, fabs(row[c]));
        }
    }
    return largest;
}

/* Taylor's series of the exponential: a sample is a fifth of a radian of the fastest motion. */
static void compute_step(hd_carrier_plate_t *plate)
{
    const generator_t g = generator(plate);
    const int n = g.signals;
    double term[HD_SIGNALS_MAX][HD_SIGNALS_MAX + HD_MODES] = {0};
    memset(plate->step, 0, sizeof plate->step);
    memset(plate->kick, 0, sizeof plate->kick);
    for (int i = 0; i < n; i++) {
        term[i][i] = plate->step[i][i] = 1.0;
    }
    double largest = 1.0;
    for (int order = 1; order <= TERMS_MAX && largest > NEGLIGIBLE; order++) {
        largest = next_term(&g, SAMPLE_S / order, term);
        for (int i = 0; i < n; i++) {
            for (int j = 0; j < n; j++) {
                plate->step[j][i] += term[i][j];
            }
            for (int k = 0; k < HD_MODES; k++) {
                plate->kick[k][i] += term[i][n + k];
            }
        }
    }
}

void hd_carrier_plate_touch(hd_carrier_plate_t *plate, const hd_contact_t *contact)
{
    bool same = memcmp(&plate->contact, contact, sizeof *contact) == 0;
    if (!same || plate->step[0][0] == 0.0) {
        plate->contact = *contact;
        compute_step(plate);
    }
}

void hd_carrier_plate_sense(const hd_carrier_plate_t *plate, double sensed_um[HD_MODES])
{
    for (int k = 0; k < HD_MODES; k++) {
        sensed_um[k] = 0.0;
        for (int p = 0; p < plate->modes; p++) {
            sensed_um[k] += plate->sensor[k][p] * plate->signal[p];
        }
    }
}

static void add(double sum[HD_SIGNALS_MAX], const double share[HD_SIGNALS_MAX], double factor, int signals)
{
    for (int i = 0; i < signals; i++) {
        sum[i] += share[i] * factor;
    }
}

void hd_carrier_plate_advance(hd_carrier_plate_t *plate, const double voltage_v[HD_MODES])
{
    const int n = signal_count(plate);
    double limit_v = plate->amplifier_limit_v;
    double next[HD_SIGNALS_MAX] = {0};
    for (int k = 0; k < HD_MODES; k++) {
        add(next, plate->kick[k], fmin(fmax(voltage_v[k], -limit_v), limit_v), n);
    }
    for (int j = 0; j < n; j++) {
        add(next, plate->step[j], plate->signal[j], n);
    }
    for (int i = 0; i < n; i++) {
        plate->signal[i] = fabs(next[i]) < HD_STILL_UM ? 0.0 : next[i];
    }
}

double complex hd_carrier_plate_amplitude_um(const hd_carrier_plate_t *plate, int p, double drive_rad_s,
                                             uint32_t phase)
{
    double speed_um = plate->signal[plate->modes + p] * plate->drive_rad_s / drive_rad_s;
    double angle_rad = (double)phase * (2.0 * 3.141592653589793 / 0x1p32);
    return (plate->signal[p] - I * speed_um) * cexp(-I * angle_rad);
}
