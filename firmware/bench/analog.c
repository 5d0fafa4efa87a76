#include "analog.h"

#include <complex.h>
#include <math.h>
#include <string.h>

#define HALF_S 0.5e-6
#define STEP_S 1e-6
#define TURN_RAD 6.283185307179586
#define HUM_HZ 50.0
#define MULTIPLIER 6364136223846793005u
#define INCREMENT 1442695040888963407u
#define AHEAD (HD_MODES % 2 == 0 ? 8 : 4)

/* PCG-XSH-RR (O'Neill, 2014). */
static inline uint32_t bits_of(uint64_t old)
{
    uint32_t shifted = (uint32_t)(((old >> 18) ^ old) >> 27), turn = (uint32_t)(old >> 59);
    return shifted >> turn | shifted << (-turn & 31u);
}

static uint32_t random_bits(an_random_t *random)
{
    uint64_t old = random->state;
    random->state = old * MULTIPLIER + INCREMENT;
    return bits_of(old);
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
#define BELL (1.7320508075688772 / 65536.0)

static inline int32_t halves_of(uint32_t bits)
{
    return (int32_t)((bits & 0xFFFFu) + (bits >> 16)) - 65535;
}

static double bell(an_random_t *random)
{
    int32_t first = halves_of(random_bits(random));
    return BELL * (first + halves_of(random_bits(random)));
}

_Static_assert(HD_CHUNK * HD_MODES % (AHEAD / 2) == 0, "a chunk's noise is whole steps");

/* The same for `n` numbers of it: several steps of the generator at once, none of which waits for another. */
static void bells(an_random_t *random, double out[], int n)
{
    uint64_t state[AHEAD], multiplier = 1u, increment = 0u;
    for (int i = 0; i < AHEAD; i++) {
        state[i] = random->state * multiplier + increment;
        increment = increment * MULTIPLIER + INCREMENT;
        multiplier *= MULTIPLIER;
    }
    for (int at = 0; at < n; at += AHEAD / 2) {
        int32_t halves[AHEAD];
        for (int i = 0; i < AHEAD; i++) {
            halves[i] = halves_of(bits_of(state[i]));
        }
        for (int i = 0; i < AHEAD; i++) {
            state[i] = state[i] * multiplier + increment;
        }
        for (int i = 0; i < AHEAD / 2; i++) {
            out[at + i] = BELL * (halves[2 * i] + halves[2 * i + 1]);
        }
    }
    random->state = state[0];
}

/* x'' + 2 s x' + O^2 x = force, in closed form over half a microsecond of constant force, and over two halves. */
static void prepare_mode(an_plate_t *plate, int p)
{
    double s = plate->decay_1_s[p], o = TURN_RAD * plate->hz[p], d = sqrt(o * o - s * s);
    double e = exp(-s * HALF_S), c = cos(d * HALF_S), n = sin(d * HALF_S) / d;
    double xx = e * (c + s * n), xv = e * n, vx = -e * o * o * n, vv = e * (c - s * n);
    double x_force = (1.0 - xx) / (o * o), v_force = e * n, phi = plate->finger[p];
    plate->xx[p] = xx * xx + xv * vx;
    plate->xv[p] = xx * xv + xv * vv;
    plate->vx[p] = vx * xx + vv * vx;
    plate->vv[p] = vx * xv + vv * vv;
    plate->x_first[p] = xx * x_force + xv * v_force;
    plate->v_first[p] = vx * x_force + vv * v_force;
    plate->x_second[p] = x_force;
    plate->v_second[p] = v_force;
    plate->phi[p] = phi;
    plate->drag[p] = 2.0 * plate->finger_1_s * phi;
    plate->halfway_x[p] = phi * vx;
    plate->halfway_v[p] = phi * vv;
    plate->halfway_force[p] = phi * v_force;
    plate->halfway_drag += phi * v_force * plate->drag[p];
    for (int k = 0; k < HD_MODES; k++) {
        plate->push[k][p] = 2.0 * TURN_RAD * plate->drive_hz * plate->gain_um_per_v_s[p][k];
        plate->hears_lsb_per_um[p][k] = plate->sees[k][p] / plate->um_per_lsb;
    }
}

void an_prepare(an_plate_t *plate)
{
    plate->halfway_drag = 0.0;
    for (int p = 0; p < plate->modes; p++) {
        prepare_mode(plate, p);
    }
    for (int s = 0; s < HD_MODES; s++) {
        plate->pickup_lsb_per_v[s] = plate->lead[s].fault == AN_SOUND ? plate->lead[s].pickup_lsb_per_v : 0.0;
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

/* What a sensor's lead makes of what all sensors show, once it is broken. */
static double through_lead(an_plate_t *plate, int s, const double own_lsb[HD_MODES], double pickup_lsb)
{
    const an_lead_t *lead = &plate->lead[s];
    double since_us = (double)plate->t_us - plate->t_fault_us, signal_lsb = own_lsb[s];
    if (since_us < 0.0) {
        return signal_lsb;
    }
    if (lead->fault == AN_FLOATING || (lead->fault == AN_INTERMITTENT && fmod(since_us, 200e3) < 10e3)) {
        double hum = lead->hum_lsb > 0.0 ? sin(TURN_RAD * HUM_HZ * 1e-6 * (double)plate->t_us + s) : 0.0;
        return pickup_lsb + lead->pickup * own_lsb[lead->other] + lead->hum_lsb * hum
            + (lead->noise_lsb > 0.0 ? lead->noise_lsb * bell(&plate->random) : 0.0);
    }
    switch (lead->fault) {
    case AN_GAIN:
        return lead->kept * signal_lsb;
    case AN_CLIPPED:
        return fmin(fmax(signal_lsb, -lead->clip_lsb), lead->clip_lsb);
    case AN_SLOW:
        return signal_lsb * fmax(0.3, 1.0 - 0.7 * since_us / 10e6);
    case AN_INVERTED:
        return -signal_lsb;
    case AN_SWAPPED:
        return own_lsb[lead->other];
    default:
        return signal_lsb;
    }
}

static uint16_t converted(double lsb)
{
    int32_t steps = (int32_t)(lsb + AN_RAIL_LSB + 0.5);
    return (uint16_t)(steps < 0 ? 0 : steps > 4095 ? 4095 : steps);
}

static inline double all_v(const an_plate_t *plate)
{
    double sum_v = 0.0;
    for (int k = 0; k < HD_MODES; k++) {
        sum_v += plate->amplifier_v[k];
    }
    return sum_v;
}

/* What the sensors show, before their leads. */
static inline void sense(const an_plate_t *plate, double own_lsb[AN_WIRE_LANES])
{
    an_wires_t signals_lsb = plate->pickup_lsb_per_v * all_v(plate);
    for (int p = 0; p < AN_MODES_MAX; p++) {
        signals_lsb += plate->hears_lsb_per_um[p] * plate->x_um[p];
    }
    memcpy(own_lsb, &signals_lsb, sizeof signals_lsb);
}

/* And behind them; with the converters' noise, for an open lead takes its own of the same. */
static void break_leads(an_plate_t *plate, double own_lsb[AN_WIRE_LANES], double noise_lsb[HD_MODES])
{
    double shown_lsb[HD_MODES];
    for (int s = 0; s < HD_MODES; s++) {
        shown_lsb[s] = through_lead(plate, s, own_lsb, plate->lead[s].pickup_lsb_per_v * all_v(plate));
        noise_lsb[s] = bell(&plate->random);
    }
    memcpy(own_lsb, shown_lsb, sizeof shown_lsb);
}

static inline double sum_of(const an_modes_t *values)
{
    double sum = 0.0;
    for (int p = 0; p < AN_MODES_MAX; p++) {
        sum += (*values)[p];
    }
    return sum;
}

static inline void move(an_plate_t *plate, an_modes_t first, an_modes_t second)
{
    an_modes_t x = plate->x_um, v = plate->v_um_s;
    if (plate->finger_1_s > 0.0) {
        an_modes_t speed = plate->phi * v;
        an_modes_t halfway = plate->halfway_x * x + plate->halfway_v * v + plate->halfway_force * first;
        double touch = sum_of(&speed);
        first -= plate->drag * touch;
        second -= plate->drag * (sum_of(&halfway) - plate->halfway_drag * touch);
    }
    plate->x_um = plate->xx * x + plate->xv * v + (plate->x_first * first + plate->x_second * second);
    plate->v_um_s = plate->vx * x + plate->vv * v + (plate->v_first * first + plate->v_second * second);
}

/* Half a microsecond with the DACs where they are, and half with them where the words put them. */
static inline void advance(an_plate_t *plate, const uint16_t words[HD_MODES])
{
    an_modes_t first = {0}, second = {0};
    for (int k = 0; k < HD_MODES; k++) {
        double v = (words[k] - AN_RAIL_LSB) * plate->v_per_lsb, limit_v = plate->v_limit_v;
        double next_v = v > limit_v ? limit_v : v < -limit_v ? -limit_v : v, amplifier_v = plate->amplifier_v[k];
        amplifier_v += plate->amplifier_share * (plate->playing_v[k] - amplifier_v);
        first += plate->push[k] * amplifier_v;
        amplifier_v += plate->amplifier_share * (next_v - amplifier_v);
        second += plate->push[k] * amplifier_v;
        plate->amplifier_v[k] = amplifier_v;
        plate->playing_v[k] = next_v;
    }
    move(plate, first, second);
}

/* The square of the largest amplitude among these modes. */
static inline double largest_um2(const an_plate_t *plate, int first, int end)
{
    double um_per_um_s = 1.0 / (TURN_RAD * plate->drive_hz), largest = 0.0;
    for (int p = first; p < end; p++) {
        double d_um = plate->x_um[p], q_um = um_per_um_s * plate->v_um_s[p], um2 = d_um * d_um + q_um * q_um;
        largest = um2 > largest ? um2 : largest;
    }
    return largest;
}

double an_parasitic_um(const an_plate_t *plate)
{
    return sqrt(largest_um2(plate, HD_MODES, plate->modes));
}

/* Whether a lead is broken in the chunk that begins. */
static bool is_broken(const an_plate_t *plate)
{
    bool any = false;
    for (int s = 0; s < HD_MODES; s++) {
        any = any || plate->lead[s].fault != AN_SOUND;
    }
    return any && (double)(plate->t_us + HD_CHUNK) > plate->t_fault_us;
}

static void convert(an_plate_t *plate, double lsb[HD_CHUNK][AN_WIRE_LANES], double noise_lsb[HD_CHUNK][HD_MODES],
                    uint16_t sampled[HD_CHUNK][HD_MODES])
{
    for (int i = 0; i < HD_CHUNK; i++) {
        for (int s = 0; s < HD_MODES; s++) {
            plate->preamplified_lsb[s] += plate->preamplifier_share * (lsb[i][s] - plate->preamplified_lsb[s]);
            sampled[i][s] = converted(plate->preamplified_lsb[s] + plate->lead[s].offset_lsb + noise_lsb[i][s]);
        }
    }
}

void an_play(an_plate_t *plate, const uint16_t words[HD_CHUNK][HD_MODES], uint16_t sampled[HD_CHUNK][HD_MODES])
{
    double lsb[HD_CHUNK][AN_WIRE_LANES], noise_lsb[HD_CHUNK][HD_MODES];
    bool broken = is_broken(plate);
    if (!broken) {
        bells(&plate->random, noise_lsb[0], HD_CHUNK * HD_MODES);
    }
    for (int i = 0; i < HD_CHUNK; i++) {
        sense(plate, lsb[i]);
        if (broken) {
            break_leads(plate, lsb[i], noise_lsb[i]);
        }
        advance(plate, words[i]);
        if (plate->t_us % AN_LOOK_US == 0) {
            plate->peak_um2 = fmax(plate->peak_um2, largest_um2(plate, 0, HD_MODES));
        }
        plate->t_us++;
    }
    convert(plate, lsb, noise_lsb, sampled);
}
