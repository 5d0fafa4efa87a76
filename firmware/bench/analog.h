/* A plate in the laboratory's frame, with everything between a DAC's pin and an ADC's: an independent judge of the core.
 *
 *   x_p'' + 2 s_p x_p' + 2 sum_f c_f phi_fp (phi_f . x') + O_p^2 x_p = 2 w sum_k g_pk a_k
 *
 * for displacements x, scaled so that their amplitude is um peak to peak, and amplifier outputs a. It shares no equation and
 * no code with boards/host: closed forms of a damped oscillator instead of envelopes or a series, random numbers of its own,
 * and converters, filters, hum and broken leads that the simulated board does not have. Time goes by microseconds; an ADC
 * samples at each, a DAC moves half-way between two. What is the same for all modes, or all wires, is computed for a vector of
 * them: a virtual second of four modes takes 40 ms.
 */
#ifndef HD_ANALOG_H
#define HD_ANALOG_H

#include <stdbool.h>
#include <stdint.h>

#include "carrier.h"
#include "protocol.h"

#define AN_MODES_MAX (HD_MODES + 3) /* and parasitic ones */
#define AN_MODE_LANES (HD_MODES > 5 ? 16 : 8)
#define AN_WIRE_LANES (HD_MODES > 4 ? 8 : HD_MODES > 2 ? 4 : 2)
#define AN_LOOK_US 10
#define AN_RAIL_LSB 2048.0

enum an_fault {
    AN_SOUND,
    AN_FLOATING,     /* an open lead, which picks something up */
    AN_GAIN,         /* part of the signal is lost */
    AN_CLIPPED,      /* the preamplifier clips within the converter's range */
    AN_SLOW,         /* the signal falls from 1 to 0.3 within 10 s */
    AN_INTERMITTENT, /* the contact opens for 10 ms of 200 */
    AN_INVERTED,
    AN_SWAPPED,      /* with the next sensor */
    AN_FAULTS
};

/* One number for each mode, and for each sensor; what is left over is 0. */
typedef double an_modes_t __attribute__((vector_size(8 * AN_MODE_LANES)));
typedef double an_wires_t __attribute__((vector_size(8 * AN_WIRE_LANES)));

typedef struct {
    uint64_t state;
} an_random_t;

double an_uniform(an_random_t *random, double low, double high);
int an_below(an_random_t *random, int n);

/* What a sensor's lead does to its signal. */
typedef struct {
    enum an_fault fault;
    int other;            /* sensor that it is swapped with, or that an open lead picks up */
    double kept;          /* of the signal */
    double clip_lsb;
    double noise_lsb, hum_lsb, offset_lsb;
    double pickup;        /* by an open lead, of the other sensor's signal */
    double pickup_lsb_per_v; /* and of each amplifier's voltage, always */
} an_lead_t;

typedef struct {
    int modes; /* the driven ones first */
    double drive_hz;
    double hz[AN_MODES_MAX], decay_1_s[AN_MODES_MAX];
    double gain_um_per_v_s[AN_MODES_MAX][HD_MODES];
    double sees[HD_MODES][AN_MODES_MAX];
    double v_per_lsb, um_per_lsb, v_limit_v;
    double amplifier_hz, preamplifier_hz; /* corners of their low passes */
    an_lead_t lead[HD_MODES];
    double t_fault_us;    /* before it every lead is sound */
    double finger_1_s, finger[AN_MODES_MAX];

    an_modes_t x_um, v_um_s;
    double amplifier_v[HD_MODES], preamplified_lsb[HD_MODES], playing_v[HD_MODES];
    uint64_t t_us;
    double peak_um2; /* the square of the largest amplitude of a driven mode so far, every AN_LOOK_US */
    an_random_t random;

    /* By an_prepare. A microsecond is two halves of constant force: what position and speed become of what they were, and of the
     * force in the first half and in the second. */
    an_modes_t xx, xv, vx, vv, x_first, v_first, x_second, v_second;
    an_modes_t push[HD_MODES];  /* force of a volt, by amplifier */
    an_wires_t hears_lsb_per_um[AN_MODES_MAX]; /* of each mode, by sensor */
    an_wires_t pickup_lsb_per_v;                /* by sound leads */
    /* The finger's force is -drag times its speed at the beginning of a half: phi.v, then that of halfway. */
    an_modes_t phi, drag, halfway_x, halfway_v, halfway_force;
    double halfway_drag;
    double amplifier_share, preamplifier_share;
} an_plate_t;

/* Computes what an advance needs of the fields above. */
void an_prepare(an_plate_t *plate);

/* The constant phase that converters and filters add to the loop, in rad. */
double an_loop_phase_rad(const an_plate_t *plate);

/* The largest of the modes that nothing is asked of. */
double an_parasitic_um(const an_plate_t *plate);

/* A chunk: samples all sensors, then moves on by a microsecond, in whose middle the words appear at the DACs, and so on. */
void an_play(an_plate_t *plate, const uint16_t words[HD_CHUNK][HD_MODES], uint16_t sampled[HD_CHUNK][HD_MODES]);

#endif
