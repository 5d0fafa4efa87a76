/* A plate in the laboratory's frame, with everything between a DAC's pin and an ADC's: an independent judge of the core.
 *
 *   x_p'' + 2 s_p x_p' + 2 sum_f c_f phi_fp (phi_f . x') + O_p^2 x_p = 2 w sum_k g_pk a_k
 *
 * for displacements x, scaled so that their amplitude is um peak to peak, and amplifier outputs a. It shares no equation and
 * no code with boards/host: closed forms of a damped oscillator instead of envelopes or a series, random numbers of its own,
 * and converters, filters, hum and broken leads that the simulated board does not have. Time goes by microseconds; an ADC
 * samples at each, a DAC moves half-way between two.
 */
#ifndef HD_ANALOG_H
#define HD_ANALOG_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol.h"

#define AN_MODES_MAX (HD_MODES + 3) /* and parasitic ones */
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

typedef struct {
    uint64_t state;
} an_random_t;

double an_uniform(an_random_t *random, double low, double high);
int an_below(an_random_t *random, int n);

/* What a sensor's lead does to its signal. */
typedef struct {
    enum an_fault fault;
    int other;            /* sensor that it is swapped with, or that an open lead hears */
    double kept;          /* of the signal */
    double clip_lsb;
    double noise_lsb, hum_lsb, offset_lsb;
    double heard;         /* by an open lead: of the other sensor's signal */
    double heard_lsb_per_v; /* and of each amplifier's voltage, always */
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

    double x_um[AN_MODES_MAX], v_um_s[AN_MODES_MAX];
    double amplifier_v[HD_MODES], preamplified_lsb[HD_MODES];
    uint16_t playing[HD_MODES];
    uint64_t t_us;
    an_random_t random;
    struct {
        double xx, xv, vx, vv, x_per_force, v_per_force;
    } half[AN_MODES_MAX]; /* of a microsecond */
    double amplifier_share, preamplifier_share;
} an_plate_t;

/* Computes what an advance needs of the fields above. */
void an_prepare(an_plate_t *plate);

/* The constant phase that converters and filters add to the loop, in rad. */
double an_loop_phase_rad(const an_plate_t *plate);

/* Samples all sensors, then moves on by a microsecond, in whose middle `words` appear at the DACs. */
void an_step(an_plate_t *plate, const uint16_t words[HD_MODES], uint16_t sampled[HD_MODES]);

double an_amplitude_um(const an_plate_t *plate, int mode);

#endif
