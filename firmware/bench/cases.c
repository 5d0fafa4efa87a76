/* The core on the independent plate (analog.h): random cases of broken leads and of sound ones, a line for each.
 *
 *   cases FAULT COUNT [SEED]
 *
 * FAULT is one of NAMES. A line has: seed, fault, wiring, control rate, damping, Hz of the texture (0: held), the
 * largest amplitude asked in um, ms from the fault to quiet (-1: never), the plate's largest amplitude over its limit,
 * and the board's fault code; of a sound case that ended in a fault whether the plate swings by itself, because a mode that is not
 * calibrated grows in the loop, or would with gains a tenth larger, or the fault was false. Cases of one seed are always the same.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "analog.h"
#include "carrier.h"
#include "codec.h"
#include "core.h"
#include "flips.h"

#define TURN_RAD 6.283185307179586
#define W_LIMIT_UM 4.0
#define V_LIMIT_V 150.0
#define DRIVE_HZ 29205.0
#define QUALITY 500.0
#define FRAME_US 20000
#define KNOTS 21
#define PARASITIC 3
#define BEGUN_US 50000
#define SWING 0.01   /* of the limit: ten times the converters' noise */
#define MARGIN 1.21  /* of the loop's gain, by which a sound plate is stable: amplifiers and sensors are known to a tenth each */
#define REST_S 1.0   /* that references are zero for, in the end, of which ringing takes the first half */

#define FLIPPED AN_FAULTS /* a bit of the memory, and every lead is sound */

static const char *const NAMES[AN_FAULTS + 1] = {
    "sound", "floating", "gain", "clipped", "slow", "intermittent", "inverted", "swapped", "flipped",
};
static const double MODE_HZ[] = {-10.0, 10.0, 25.0, -30.0, 60.0, -75.0, 120.0, -140.0};

typedef struct {
    an_plate_t plate;
    hd_core_t core;
    hd_carrier_t carrier;
    hd_config_t config;
    bool paper;
    double damping, texture_hz, seconds, rests_s;
    double parasitic_um, resting_um; /* the farthest that a mode which is not calibrated went after BEGUN_US, and at rest */
    double asked_um[HD_MODES];
    uint16_t seq;
    uint16_t playing[HD_CHUNK][HD_MODES], next[HD_CHUNK][HD_MODES], sampled[HD_CHUNK][HD_MODES];
    double last_drive_us;
    an_flip_t flip;
    bool flipped;
    double over_v, over_us, longest_over_us; /* the highest voltage, and how long without a pause one was above the limit */
    uint8_t behind[UINT8_MAX * sizeof(hd_polyline_t)]; /* what a turned index reads there is memory on a board, too */
} case_t;

/* Sums and differences of neighbours, as on the paper's rig; or a wire for each. */
static double mixed(bool paper, int amplifier, int mode)
{
    if (!paper || amplifier / 2 != mode / 2 || (amplifier | 1) >= HD_MODES || (mode | 1) >= HD_MODES) {
        return amplifier == mode;
    }
    return amplifier % 2 == 1 && mode % 2 == 1 ? -1.0 : 1.0;
}

static double gain_um_per_v_s(void)
{
    return W_LIMIT_UM / V_LIMIT_V * hypot(TURN_RAD / 2.0 * DRIVE_HZ / QUALITY, TURN_RAD * 10.0);
}

static void draw_plate(case_t *c, an_random_t *random, enum an_fault fault)
{
    an_plate_t *plate = &c->plate;
    bool sound = fault == AN_SOUND;
    double drift_hz = an_uniform(random, -1.0, 1.0) * (sound ? 60.0 : an_below(random, 2) * 20.0);
    plate->modes = HD_MODES + PARASITIC;
    plate->drive_hz = DRIVE_HZ;
    plate->v_per_lsb = 0.0886;
    plate->um_per_lsb = 0.0039;
    plate->v_limit_v = 1.05 * V_LIMIT_V;
    plate->amplifier_hz = plate->preamplifier_hz = 150e3;
    for (int p = 0; p < plate->modes; p++) {
        bool driven = p < HD_MODES;
        double off_hz = driven ? MODE_HZ[p] + drift_hz : an_uniform(random, 500.0, 3000.0) * (p % 2 == 0 ? 1.0 : -1.0);
        plate->hz[p] = DRIVE_HZ + off_hz;
        plate->decay_1_s[p] = c->damping * TURN_RAD / 2.0 * plate->hz[p] / QUALITY;
        double off = driven && sound ? an_uniform(random, 0.9, 1.1) : 1.0;
        for (int k = 0; k < HD_MODES; k++) {
            double share = driven ? off * mixed(c->paper, k, p) : an_uniform(random, -0.3, 0.3);
            plate->gain_um_per_v_s[p][k] = gain_um_per_v_s() * share;
            double sees = driven ? mixed(c->paper, k, p) : an_uniform(random, -0.2, 0.2);
            sees *= c->paper && driven && (k | 1) < HD_MODES ? sqrt(0.5) : 1.0;
            plate->sees[k][p] = sees + (driven && k != p ? an_uniform(random, -0.01, 0.01) : 0.0);
        }
        plate->finger[p] = an_uniform(random, -1.0, 1.0);
    }
    plate->finger_1_s = an_below(random, 2) * an_uniform(random, 0.0, 345.0);
}

static void draw_leads(case_t *c, an_random_t *random, enum an_fault fault)
{
    an_plate_t *plate = &c->plate;
    bool sound = fault == AN_SOUND;
    int first = an_below(random, HD_MODES), broken = an_below(random, 3) == 0 ? HD_MODES : 1;
    plate->t_fault_us = an_below(random, 2) == 0 ? 0.0 : an_uniform(random, 60e3, 200e3);
    for (int n = 0; n < HD_MODES; n++) {
        int s = (first + n) % HD_MODES, next = (first + 1) % HD_MODES;
        an_lead_t *lead = &plate->lead[s];
        lead->offset_lsb = an_uniform(random, -40.0, 40.0);
        lead->other = (s + 1) % HD_MODES;
        bool clipped = an_below(random, 2) == 0;
        double percent_um = an_uniform(random, 0.002, sound ? 0.01 : 0.03) * W_LIMIT_UM;
        if (fault == AN_SWAPPED) {
            lead->fault = s == first || s == next ? fault : AN_SOUND;
            lead->other = s == first ? next : first;
        } else {
            lead->fault = n < broken && !(fault == AN_INVERTED && n > 0) ? fault : AN_SOUND;
        }
        lead->kept = an_uniform(random, 0.1, 0.5);
        lead->clip_lsb = an_uniform(random, 0.1, 0.6) * W_LIMIT_UM / plate->um_per_lsb;
        lead->noise_lsb = an_uniform(random, 0.0, 40.0);
        lead->hum_lsb = an_below(random, 2) * an_uniform(random, 0.0, 600.0);
        lead->pickup = an_below(random, 2) * an_uniform(random, -0.03, 0.03);
        if (lead->fault == AN_FLOATING || fault == AN_SOUND) {
            lead->pickup_lsb_per_v = (clipped ? 1.0 : 0.0) * percent_um / V_LIMIT_V / plate->um_per_lsb / HD_MODES;
        }
    }
}

static void draw_references(case_t *c, an_random_t *random, enum an_fault fault)
{
    double scale_um = exp(an_uniform(random, log(0.2), log(W_LIMIT_UM)));
    c->texture_hz = an_below(random, 2) == 0 ? 0.0 : exp(an_uniform(random, log(5.0), log(250.0)));
    for (int k = 0; k < HD_MODES; k++) {
        c->asked_um[k] = scale_um * an_uniform(random, 0.2, 1.0) * (an_below(random, 2) == 0 ? 1.0 : -1.0);
    }
    c->seconds = fault == AN_SLOW ? 11.0 : fault == AN_INTERMITTENT ? 2.5 : fault == AN_SOUND ? 3.0 : 0.6;
}

static void configure(case_t *c, double control_hz)
{
    hd_config_t *config = &c->config;
    double phase = an_loop_phase_rad(&c->plate);
    *config = (hd_config_t){
        .boot_id = 1, .control_hz = (float)control_hz, .drive_hz = (float)DRIVE_HZ, .v_limit_v = (float)V_LIMIT_V,
        .gains = {.law = HD_LAW_DEADBEAT}, .output_delay_frac = (float)(HD_CHUNK * 1e-6 * control_hz),
    };
    hd_converters_t converters = {.drive_hz = (float)DRIVE_HZ, .control_hz = (float)control_hz};
    for (int k = 0; k < HD_MODES; k++) {
        bool pair = c->paper && (k | 1) < HD_MODES;
        config->w_limit_um[k] = (float)W_LIMIT_UM;
        config->model[k] = (hd_mode_model_t){
            (float)(TURN_RAD / 2.0 * (DRIVE_HZ + MODE_HZ[k]) / QUALITY), (float)(TURN_RAD * MODE_HZ[k]),
            (float)((pair ? 2.0 : 1.0) * gain_um_per_v_s()), {(float)cos(phase), (float)sin(phase)},
        };
        for (int p = 0; p < HD_MODES; p++) {
            config->wiring.drive[k][p] = (float)mixed(c->paper, k, p);
            config->wiring.sense[k][p].d = (float)(mixed(c->paper, k, p) * (pair ? sqrt(0.5) : 1.0));
        }
        converters.volts_per_lsb[k] = (float)c->plate.v_per_lsb;
        converters.um_per_lsb[k] = (float)c->plate.um_per_lsb;
    }
    if (!hd_carrier_init(&c->carrier, &converters) || !hd_init(&c->core, config, 0)) {
        fprintf(stderr, "a case that the core refuses\n");
        exit(1);
    }
}

static void ask(case_t *c, uint32_t now_us)
{
    struct HD_PACKED {
        hd_wire_reference_t head;
        hd_wire_knot_t knot[KNOTS];
    } message = {{c->seq++, now_us, KNOTS, HD_MODES}, {{0}}};
    for (int n = 0; n < KNOTS; n++) {
        double t_s = 1e-6 * now_us + 1e-3 * n;
        double share = t_s >= c->rests_s ? 0.0 : c->texture_hz > 0.0 ? cos(TURN_RAD * c->texture_hz * t_s) : 1.0;
        message.knot[n].offset = (uint16_t)(n * 1000 / HD_KNOT_UNIT_US);
        for (int k = 0; k < HD_MODES; k++) {
            message.knot[n].modal[k].d_um = (float)(share * c->asked_um[k]);
        }
    }
    uint8_t line[HD_LINE_SIZE(HD_FRAME_MAX)];
    hd_receive(&c->core, line, hd_frame_encode(HD_MSG_REFERENCE, &message, sizeof message, line), now_us);
}

static void play_chunk(case_t *c)
{
    an_play(&c->plate, (const uint16_t (*)[HD_MODES])c->playing, c->sampled);
    memcpy(c->playing, c->next, sizeof c->playing);
}

/* What a chunk plays, against the limit: a wave's crests are at most half a step and a sample from its amplitude. */
static void watch_voltage(case_t *c)
{
    int most_lsb = 0;
    for (int i = 0; i < HD_CHUNK * HD_MODES; i++) {
        int lsb = abs(c->next[i / HD_MODES][i % HD_MODES] - (int)AN_RAIL_LSB);
        most_lsb = lsb > most_lsb ? lsb : most_lsb;
    }
    double most_v = most_lsb * c->plate.v_per_lsb;
    c->over_v = fmax(c->over_v, most_v);
    c->over_us = most_v > V_LIMIT_V + c->plate.v_per_lsb ? c->over_us + HD_CHUNK : 0.0;
    c->longest_over_us = fmax(c->longest_over_us, c->over_us);
}

/* As main.c has it. */
static void control(case_t *c)
{
    hd_phasor_t measured_um[HD_MODES], voltage_v[HD_MODES];
    if (hd_carrier_listen(&c->carrier, (const uint16_t (*)[HD_MODES])c->sampled)) {
        hd_carrier_measure(&c->carrier, measured_um);
        int judged = c->core.control.turn;
        c->core.clips = hd_carrier_clips(&c->carrier, judged, measured_um[judged]);
        if (hd_sweeps_carrier(&c->core.sweep) && !hd_carrier_intact(&c->carrier)) {
            hd_lose_memory(&c->core, HD_DAMAGE_CARRIER, (uint32_t)c->plate.t_us);
        }
        hd_tick(&c->core, (uint32_t)c->plate.t_us, measured_um, voltage_v);
        hd_carrier_tune(&c->carrier, c->core.drive_hz);
        hd_carrier_drive(&c->carrier, voltage_v);
        for (int k = 0; k < HD_MODES; k++) {
            c->last_drive_us = voltage_v[k].d != 0.0f || voltage_v[k].q != 0.0f ? (double)c->plate.t_us : c->last_drive_us;
        }
    }
    hd_carrier_speak(&c->carrier, c->next);
    if (c->flip.byte != NULL) {
        watch_voltage(c);
    }
}

static void flip_when_due(case_t *c)
{
    if (c->flip.byte != NULL && !c->flipped && (double)c->plate.t_us >= c->plate.t_fault_us) {
        an_turn_over(&c->flip);
        c->flipped = true;
    }
}

static void play(case_t *c)
{
    uint64_t end_us = (uint64_t)(1e6 * c->seconds);
    for (int i = 0; i < HD_CHUNK * HD_MODES; i++) {
        c->playing[i / HD_MODES][i % HD_MODES] = c->next[i / HD_MODES][i % HD_MODES] = HD_MID_RAIL;
    }
    while (c->plate.t_us < end_us) {
        if (c->plate.t_us % FRAME_US == 0) {
            for (int n = c->plate.t_us == 0 ? 3 : 1; n > 0; n--) {
                ask(c, (uint32_t)c->plate.t_us);
            }
        }
        play_chunk(c);
        flip_when_due(c);
        control(c);
        if (c->plate.t_us > BEGUN_US) {
            double um = an_parasitic_um(&c->plate);
            bool rests = 1e-6 * (double)c->plate.t_us > c->rests_s + 0.5 * REST_S;
            c->parasitic_um = fmax(c->parasitic_um, um);
            c->resting_um = rests ? fmax(c->resting_um, um) : 0.0;
        }
        if (c->core.state == HD_STATE_FAULT && (double)c->plate.t_us > c->last_drive_us + 20e3) {
            break;
        }
    }
}

static void draw(case_t *c, enum an_fault fault, unsigned seed)
{
    an_random_t random = {0x9E3779B97F4A7C15u * (seed + 1u) + (unsigned)fault};
    memset(c, 0, sizeof *c);
    for (int n = 0; n < 8; n++) {
        an_uniform(&random, 0.0, 1.0);
    }
    c->damping = exp(an_uniform(&random, log(0.5), log(3.0)));
    c->paper = an_below(&random, 2) == 1;
    double control_hz = an_below(&random, 2) == 0 ? 2000.0 : 5000.0;
    enum an_fault drawn = fault == FLIPPED ? AN_SOUND : fault;
    draw_plate(c, &random, drawn);
    draw_leads(c, &random, drawn);
    draw_references(c, &random, drawn);
    if (fault == FLIPPED) {
        c->flip = an_draw_flip(&random, &c->core, &c->carrier);
        c->plate.t_fault_us = an_uniform(&random, 60e3, 100e3);
        c->plate.v_limit_v = 2.0 * V_LIMIT_V; /* the amplifiers' own limit saves nothing here */
        c->seconds = 0.5;
    }
    c->rests_s = INFINITY;
    c->plate.random.state = random.state | 1u;
    an_prepare(&c->plate);
    configure(c, control_hz);
}

/* A sound case that is not watched, and rests in the end; sensors see so many times of the modes that are not calibrated. */
static const case_t *unwatched(case_t *c, unsigned seed, double seen)
{
    draw(c, AN_SOUND, seed);
    c->rests_s = c->seconds;
    c->seconds += REST_S;
    c->core.swing_turns = c->core.distrust_turns = c->core.patience_ticks = UINT16_MAX;
    hd_memory_init(&c->core); /* as if it had been so from the start */
    for (int p = HD_MODES; p < c->plate.modes; p++) {
        for (int k = 0; k < HD_MODES; k++) {
            c->plate.sees[k][p] *= seen;
        }
    }
    an_prepare(&c->plate);
    play(c);
    return c;
}

/* Whether the plate of a sound case swings by itself: unwatched, a mode that is not calibrated goes farther in the loop, by
 * SWING of the limit, than it does on the plate whose sensors do not see it, or does not come to rest. In the loop as it is, or with
 * MARGIN: on its edge, what probes move rings for longer than the board watches it. */
static bool swings(unsigned seed)
{
    static case_t seeing, blind;
    const case_t *unseen = unwatched(&blind, seed, 0.0);
    for (int i = 0; i < 2; i++) {
        const case_t *seen = unwatched(&seeing, seed, i == 0 ? 1.0 : MARGIN);
        if (seen->core.fault == HD_FAULT_OVER_AMPLITUDE || seen->resting_um > unseen->resting_um + SWING * W_LIMIT_UM
            || seen->parasitic_um > unseen->parasitic_um + SWING * W_LIMIT_UM) {
            return true;
        }
    }
    return false;
}

static void play_case(enum an_fault fault, unsigned seed)
{
    static case_t c;
    draw(&c, fault, seed);
    play(&c);
    double most_um = 0.0;
    for (int k = 0; k < HD_MODES; k++) {
        most_um = fmax(most_um, fabs(c.asked_um[k]));
    }
    double quiet_ms = 1e-3 * (c.last_drive_us - c.plate.t_fault_us);
    bool quiet = c.core.state == HD_STATE_FAULT;
    printf("%u %s %s %.0f %.3f %.1f %.3f %.1f %.4f %d", seed, NAMES[fault], c.paper ? "paper" : "own", c.config.control_hz,
           c.damping, c.texture_hz, most_um, quiet ? fmax(quiet_ms, 0.0) : -1.0, sqrt(c.plate.peak_um2) / W_LIMIT_UM,
           c.core.fault);
    if (c.flipped) {
        printf(" %s %td %.1f %.2f", c.flip.what, c.flip.at, c.over_v, 1e-3 * c.longest_over_us);
        an_mend(&c.flip);
    }
    if (fault == AN_SOUND && quiet) {
        fputs(swings(seed) ? " swings" : " false", stdout);
    }
    putchar('\n');
}

int main(int count, char **words)
{
    int fault = 0;
    setvbuf(stdout, NULL, _IOLBF, 0);
    while (count >= 3 && fault <= FLIPPED && strcmp(words[1], NAMES[fault]) != 0) {
        fault++;
    }
    if (count < 3 || fault > FLIPPED) {
        fprintf(stderr, "usage: cases sound|floating|gain|clipped|slow|intermittent|inverted|swapped|flipped COUNT [SEED]\n");
        return 2;
    }
    unsigned cases = (unsigned)strtoul(words[2], NULL, 10), seed = count > 3 ? (unsigned)strtoul(words[3], NULL, 10) : 0u;
    for (unsigned n = 0; n < cases; n++) {
        play_case((enum an_fault)fault, seed + n);
    }
    return 0;
}
