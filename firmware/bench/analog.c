#include "analog.h"

#include <complex.h>
#include <math.h>

#define HALF_S 0.5e-6
#define STEP_S 1e-6
#define TURN_RAD 6.283185307179586
#define HUM_HZ 50.0

/* PCG-XSH-RR (O'Neill, 2014). */
static uint32_t random_bits(an_random_t *random)
{
    uint64_t old = random->state;
    random->state = old * 6364136223846793005u + 1442695040888963407u;
    uint32_t shifted = (uint32_t)(((old >> 18) ^ old) >> 27), turn = (uint32_t)(old >> 59);
    return shifted >> turn | shifted << (-turn & 31u);
}

double an_uniform(an_random_t *random, double low, double high)
{
    return low + (high - low) * (random_bits(random) + 0.5) * 0x1p-32;
}

int an_below(an_random_t *random, int n)
{
    return (int)(((uint64_t)random_bits(random) * (uint64_t)n) >> 32);
}

/* A sum of four 16-bit numbers, scaled: a bell that ends at 3.5 standard deviations, which is enough for a converter. */
static double bell(an_random_t *random)
{
    uint32_t a = random_bits(random), b = random_bits(random);
    double sum = (double)((a & 0xFFFFu) + (a >> 16) + (b & 0xFFFFu) + (b >> 16));
    return (sum - 2.0 * 65535.0) * (1.7320508075688772 / 65536.0);
}

/* x'' + 2 s x' + O^2 x = force, in closed form over half a microsecond of constant force. */
static void prepare_mode(an_plate_t *plate, int p)
{
    double s = plate->decay_1_s[p], o = TURN_RAD * plate->hz[p], d = sqrt(o * o - s * s);
    double e = exp(-s * HALF_S), c = cos(d * HALF_S), n = sin(d * HALF_S) / d;
    plate->half[p].xx = e * (c + s * n);
    plate->half[p].xv = e * n;
    plate->half[p].vx = -e * o * o * n;
    plate->half[p].vv = e * (c - s * n);
    plate->half[p].x_per_force = (1.0 - plate->half[p].xx) / (o * o);
    plate->half[p].v_per_force = e * n;
}

void an_prepare(an_plate_t *plate)
{
    for (int p = 0; p < plate->modes; p++) {
        prepare_mode(plate, p);
    }
    plate->amplifier_share = 1.0 - exp(-TURN_RAD * plate->amplifier_hz * HALF_S);
    plate->preamplifier_share = 1.0 - exp(-TURN_RAD * plate->preamplifier_hz * STEP_S);
}

static double complex filtered(double share, double angle_rad)
{
    return share / (1.0 - (1.0 - share) * cexp(-I * angle_rad));
}

double an_loop_phase_rad(const an_plate_t *plate)
{
    double rad_s = TURN_RAD * plate->drive_hz;
    double held = -rad_s * (HALF_S + HALF_S); /* it appears half a sample late, and is held for one */
    return held + carg(filtered(plate->amplifier_share, rad_s * HALF_S))
        + carg(filtered(plate->preamplifier_share, rad_s * STEP_S));
}

static double signal_lsb(const an_plate_t *plate, int s)
{
    double um = 0.0;
    for (int p = 0; p < plate->modes; p++) {
        um += plate->sees[s][p] * plate->x_um[p];
    }
    return um / plate->um_per_lsb;
}

static double through_lead(an_plate_t *plate, int s)
{
    const an_lead_t *lead = &plate->lead[s];
    double own_lsb = signal_lsb(plate, s);
    double since_us = (double)plate->t_us - plate->t_fault_us;
    enum an_fault fault = since_us >= 0.0 ? lead->fault : AN_SOUND;
    bool open = fault == AN_FLOATING || (fault == AN_INTERMITTENT && fmod(since_us, 200e3) < 10e3);
    double heard_lsb = 0.0;
    for (int k = 0; k < HD_MODES; k++) {
        heard_lsb += lead->heard_lsb_per_v * plate->amplifier_v[k];
    }
    if (open) {
        double hum = sin(TURN_RAD * HUM_HZ * 1e-6 * (double)plate->t_us + s);
        return heard_lsb + lead->heard * signal_lsb(plate, lead->other) + lead->hum_lsb * hum
            + (lead->noise_lsb > 0.0 ? lead->noise_lsb * bell(&plate->random) : 0.0);
    }
    switch (fault) {
    case AN_GAIN:
        return lead->kept * own_lsb;
    case AN_CLIPPED:
        return fmin(fmax(own_lsb, -lead->clip_lsb), lead->clip_lsb);
    case AN_SLOW:
        return own_lsb * fmax(0.3, 1.0 - 0.7 * since_us / 10e6);
    case AN_INVERTED:
        return -own_lsb;
    case AN_SWAPPED:
        return signal_lsb(plate, lead->other);
    default:
        return own_lsb;
    }
}

static uint16_t converted(an_plate_t *plate, int s)
{
    plate->preamplified_lsb[s] += plate->preamplifier_share * (through_lead(plate, s) - plate->preamplified_lsb[s]);
    double lsb = plate->preamplified_lsb[s] + plate->lead[s].offset_lsb + bell(&plate->random);
    double code = fmin(fmax(floor(lsb + AN_RAIL_LSB + 0.5), 0.0), 4095.0);
    return (uint16_t)code;
}

/* Half a microsecond with the DACs where they are. */
static void advance(an_plate_t *plate)
{
    double rad_s = TURN_RAD * plate->drive_hz, touch = 0.0;
    for (int k = 0; k < HD_MODES; k++) {
        double v = (plate->playing[k] - AN_RAIL_LSB) * plate->v_per_lsb;
        v = fmin(fmax(v, -plate->v_limit_v), plate->v_limit_v);
        plate->amplifier_v[k] += plate->amplifier_share * (v - plate->amplifier_v[k]);
    }
    for (int p = 0; plate->finger_1_s > 0.0 && p < plate->modes; p++) {
        touch += plate->finger[p] * plate->v_um_s[p];
    }
    for (int p = 0; p < plate->modes; p++) {
        double force = -2.0 * plate->finger_1_s * plate->finger[p] * touch;
        for (int k = 0; k < HD_MODES; k++) {
            force += 2.0 * rad_s * plate->gain_um_per_v_s[p][k] * plate->amplifier_v[k];
        }
        double x = plate->x_um[p], v = plate->v_um_s[p];
        plate->x_um[p] = plate->half[p].xx * x + plate->half[p].xv * v + plate->half[p].x_per_force * force;
        plate->v_um_s[p] = plate->half[p].vx * x + plate->half[p].vv * v + plate->half[p].v_per_force * force;
    }
}

void an_step(an_plate_t *plate, const uint16_t words[HD_MODES], uint16_t sampled[HD_MODES])
{
    for (int s = 0; s < HD_MODES; s++) {
        sampled[s] = converted(plate, s);
    }
    advance(plate);
    for (int k = 0; k < HD_MODES; k++) {
        plate->playing[k] = words[k];
    }
    advance(plate);
    plate->t_us++;
}

double an_amplitude_um(const an_plate_t *plate, int mode)
{
    return hypot(plate->x_um[mode], plate->v_um_s[mode] / (TURN_RAD * plate->drive_hz));
}
