#include "lockstep.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "carrier_loop.h"
#include "core.h"
#include "plate.h"

/* From the end of a measured tick to the new voltage, in seconds: one chunk of the carrier (carrier.h). */
#define OUTPUT_DELAY_S ((double)HD_CHUNK / HD_SAMPLE_HZ)

#define TWO_PI 6.283185307179586

struct hd_board {
    hd_core_t core;
    hd_config_t configured; /* what every boot begins with */
    hd_plate_t plate;
    hd_carrier_loop_t *carrier; /* NULL: the plate's envelopes are all there is */
    uint64_t t_start_us;
    uint64_t tick;
    double tick_us;
    double output_delay_frac;
    double frame_rad_s; /* of the drive as the plate has it, above the configured one */
    double complex voltage_v[HD_MODES];         /* the core's last answer */
    double complex applied_v[HD_MODES];         /* on the plate: the same, but for the first part of a tick */
    double complex mean_um[HD_PLATE_MODES_MAX]; /* over the tick just ended */
    double complex measured_um[HD_MODES];
    double complex fake_um[HD_MODES];
    bool faked;
    uint8_t interlock; /* the event that forbids to drive; 0: none */
    uint8_t interlock_before;
    double complex asked_um[HD_MODES][2]; /* input of the control law at the last two ticks */
};

int32_t hd_board_modes(void)
{
    return HD_MODES;
}

size_t hd_board_setup_size(void)
{
    return sizeof(hd_board_setup_t);
}

/* Element (i, j) of a complex matrix of HD_MODES columns; 0 of one that is not given. */
static double complex pair(const double *pairs, int i, int j)
{
    const double *at = pairs + 2 * (i * HD_MODES + j);
    return pairs == NULL ? 0.0 : CMPLX(at[0], at[1]);
}

static hd_phasor_t phasor_of(double complex value)
{
    return (hd_phasor_t){(float)creal(value), (float)cimag(value)};
}

static void set_up_plate(hd_plate_t *plate, const hd_board_setup_t *setup)
{
    plate->modes = setup->plate_modes;
    plate->noise_um = setup->noise_um;
    plate->amplifier_limit_v = setup->amplifier_limit_v;
    plate->random = setup->seed;
    for (int k = 0; k < HD_MODES; k++) {
        plate->loop[k] = cexp(I * setup->loop_phase_rad[k]);
        for (int a = 0; a < HD_MODES; a++) {
            plate->through_um_per_v[k][a] = pair(setup->through_um_per_v, k, a);
        }
    }
    for (int p = 0; p < plate->modes; p++) {
        plate->decay_1_s[p] = setup->decay_1_s[p];
        plate->detuning_rad_s[p] = setup->detuning_rad_s[p];
        for (int k = 0; k < HD_MODES; k++) {
            plate->gain_um_per_v_s[p][k] = setup->gain_um_per_v_s[p * HD_MODES + k];
            int at = k * plate->modes + p;
            plate->sensor[k][p] =
                CMPLX(setup->sensor[at], setup->sensor_imaginary == NULL ? 0.0 : setup->sensor_imaginary[at]);
        }
    }
}

hd_config_t hd_board_config(const hd_board_setup_t *setup)
{
    hd_config_t config = {
        .boot_id = setup->boot_id,
        .control_hz = (float)setup->control_hz,
        .drive_hz = (float)setup->drive_hz,
        .v_limit_v = (float)setup->v_limit_v,
        .gains = {(uint8_t)setup->law, (float)setup->bandwidth_1_s, (float)setup->integral_time_s},
        .output_delay_frac = (float)(OUTPUT_DELAY_S * setup->control_hz),
        .latch_repeated_trips = setup->latch_repeated_trips != 0,
        .reset_cause = (uint8_t)setup->reset_cause,
        .features = setup->has_sync != 0 ? HD_FEATURE_SYNC : 0,
        .baud_max = setup->baud_max,
        .image_crc = setup->image_crc,
    };
    for (int k = 0; k < HD_MODES; k++) {
        config.w_limit_um[k] = (float)setup->w_limit_um[k];
        config.model[k] = (hd_mode_model_t){
            (float)setup->nominal_decay_1_s[k],
            (float)setup->nominal_detuning_rad_s[k],
            (float)setup->nominal_gain_um_per_v_s[k],
            {(float)cos(setup->nominal_loop_phase_rad[k]), (float)sin(setup->nominal_loop_phase_rad[k])},
        };
        for (int n = 0; n < HD_MODES; n++) {
            config.wiring.drive[k][n] = setup->drive == NULL ? k == n : (float)setup->drive[k * HD_MODES + n];
            config.wiring.sense[k][n] = phasor_of(setup->sense == NULL ? k == n : pair(setup->sense, k, n));
            config.wiring.feedthrough_um_per_v[k][n] = phasor_of(pair(setup->feedthrough_um_per_v, k, n));
        }
    }
    return config;
}

static bool set_up_carrier(hd_board_t *board, const hd_board_setup_t *setup)
{
    if (setup->converters == NULL) {
        return true;
    }
    board->carrier = malloc(sizeof *board->carrier);
    return board->carrier != NULL && hd_carrier_loop_init(board->carrier, setup);
}

hd_board_t *hd_board_new(const hd_board_setup_t *setup)
{
    hd_board_t *board = calloc(1, sizeof *board);
    if (board == NULL) {
        return NULL;
    }
    hd_config_t config = hd_board_config(setup);
    bool valid = setup->plate_modes >= 1 && setup->plate_modes <= HD_PLATE_MODES_MAX;
    if (!valid || !hd_init(&board->core, &config, (uint32_t)setup->t_start_us) || !set_up_carrier(board, setup)) {
        hd_board_free(board);
        return NULL;
    }
    board->configured = config;
    set_up_plate(&board->plate, setup);
    board->t_start_us = setup->t_start_us;
    board->tick_us = 1e6 / setup->control_hz;
    board->output_delay_frac = OUTPUT_DELAY_S * setup->control_hz;
    return board;
}

void hd_board_free(hd_board_t *board)
{
    if (board != NULL) {
        free(board->carrier);
        free(board);
    }
}

static uint64_t elapsed_us(const hd_board_t *board)
{
    return (uint64_t)llround((double)board->tick * board->tick_us);
}

void hd_board_reset(hd_board_t *board, uint32_t boot_id, int32_t cause)
{
    hd_config_t config = board->configured;
    config.boot_id = boot_id;
    config.reset_cause = (uint8_t)cause;
    config.log = board->core.config.log; /* in memory that a reset does not clear */
    board->t_start_us = 0 - elapsed_us(board);
    hd_init(&board->core, &config, 0);
    memset(board->voltage_v, 0, sizeof board->voltage_v);
    memset(board->applied_v, 0, sizeof board->applied_v);
    memset(board->asked_um, 0, sizeof board->asked_um);
}

uint64_t hd_board_t_us(const hd_board_t *board)
{
    return board->t_start_us + elapsed_us(board);
}

void hd_board_skip(hd_board_t *board, uint64_t ticks)
{
    board->tick += ticks;
}

void hd_board_receive(hd_board_t *board, const uint8_t *bytes, size_t n, uint64_t at_us)
{
    hd_receive(&board->core, bytes, n, (uint32_t)at_us);
}

size_t hd_board_transmit(hd_board_t *board, uint8_t *out, size_t capacity, uint64_t at_us)
{
    return hd_transmit(&board->core, (uint32_t)at_us, out, capacity);
}

uint32_t hd_board_baud(hd_board_t *board)
{
    return hd_line_baud(&board->core, (uint32_t)hd_board_t_us(board));
}

void hd_board_estimate(const hd_board_t *board, double *estimate)
{
    for (int k = 0; k < HD_MODES; k++) {
        hd_estimate_t learned = hd_control_estimate(&board->core.control, k);
        estimate[2 * k] = (double)learned.decay_1_s;
        estimate[2 * k + 1] = (double)learned.detuning_rad_s;
    }
}

void hd_board_detune(hd_board_t *board, const double *detuning_rad_s)
{
    memcpy(board->plate.detuning_rad_s, detuning_rad_s, (size_t)board->plate.modes * sizeof *detuning_rad_s);
}

void hd_board_fake_measurement(hd_board_t *board, const double *measured_um)
{
    board->faked = measured_um != NULL;
    for (int k = 0; board->faked && k < HD_MODES; k++) {
        board->fake_um[k] = CMPLX(measured_um[2 * k], measured_um[2 * k + 1]);
    }
}

bool hd_board_leads(hd_board_t *board, const hd_lead_t *leads)
{
    if (board->carrier != NULL) {
        memcpy(board->carrier->lead, leads, sizeof board->carrier->lead);
    }
    return board->carrier != NULL;
}

void hd_board_interlock(hd_board_t *board, uint8_t event)
{
    board->interlock = event;
}

/* hd_on_interlock of main.c. */
static void obey_interlock(hd_board_t *board)
{
    hd_core_t *core = &board->core;
    uint32_t now_us = (uint32_t)hd_board_t_us(board);
    uint8_t event = board->interlock;
    if (event != 0 && event != board->interlock_before) {
        hd_wire_log_entry_t entry = {now_us, core->config.boot_id, event, 255, 0.0f};
        hd_log_add(&core->config.log, &entry);
    }
    board->interlock_before = event;
    bool drives = core->state == HD_STATE_LIVE || core->state == HD_STATE_TOOL || core->ramp > 0;
    if (event != 0 && drives) {
        hd_lose_samples(core, now_us);
    } else if (event != 0) {
        hd_deadman_reset(&core->deadman);
    }
}

static double complex complex_of(hd_phasor_t phasor)
{
    return CMPLX((double)phasor.d, (double)phasor.q);
}

/* A law may get its reference ahead of time; the reference at the tick itself is then between the last
 * two. */
static void reference_at_tick(hd_board_t *board, double complex reference_um[HD_MODES])
{
    bool ahead = board->core.control.design.lookahead_us > 0;
    for (int k = 0; k < HD_MODES; k++) {
        double complex *asked_um = board->asked_um[k];
        double complex newest_um = complex_of(board->core.asked_um[k]);
        double complex between_um = asked_um[0] + board->output_delay_frac * (asked_um[1] - asked_um[0]);
        reference_um[k] = ahead ? between_um : newest_um;
        asked_um[1] = asked_um[0];
        asked_um[0] = newest_um;
    }
}

/* A changed drive frequency goes out with the new voltage, and the frame turns with it: W goes on without a jump. */
static void envelope_tick(hd_board_t *board, const hd_contact_t *contact)
{
    double tick_s = board->tick_us * 1e-6;
    double complex integral_um_s[HD_PLATE_MODES_MAX] = {0};
    hd_plate_advance(&board->plate, contact, board->applied_v, board->frame_rad_s, OUTPUT_DELAY_S, integral_um_s);
    double complex mean_v[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        mean_v[k] = board->voltage_v[k] + board->output_delay_frac * (board->applied_v[k] - board->voltage_v[k]);
    }
    memcpy(board->applied_v, board->voltage_v, sizeof board->applied_v);
    board->frame_rad_s = TWO_PI * (double)(board->core.drive_hz - board->core.config.drive_hz);
    hd_plate_advance(&board->plate, contact, board->applied_v, board->frame_rad_s, tick_s - OUTPUT_DELAY_S,
                     integral_um_s);
    for (int p = 0; p < board->plate.modes; p++) {
        board->mean_um[p] = integral_um_s[p] / tick_s;
    }
    hd_plate_measure(&board->plate, board->mean_um, mean_v, board->measured_um);
}

static void carrier_tick(hd_board_t *board, const hd_contact_t *contact)
{
    hd_phasor_t measured_um[HD_MODES];
    hd_carrier_loop_listen(board->carrier, contact, measured_um);
    int judged = board->core.control.turn;
    board->core.clips = hd_carrier_clips(&board->carrier->carrier, judged, measured_um[judged]);
    if (hd_sweeps_carrier(&board->core.sweep) && !hd_carrier_intact(&board->carrier->carrier)) {
        hd_lose_memory(&board->core, HD_DAMAGE_CARRIER, (uint32_t)hd_board_t_us(board));
    }
    for (int k = 0; k < HD_MODES; k++) {
        board->measured_um[k] = complex_of(measured_um[k]);
    }
    for (int p = 0; p < board->plate.modes; p++) {
        board->plate.w_um[p] = hd_carrier_loop_amplitude_um(board->carrier, p);
    }
}

static void plate_tick(hd_board_t *board, const hd_contact_t *contact)
{
    if (board->carrier != NULL) {
        carrier_tick(board, contact);
    } else {
        envelope_tick(board, contact);
    }
    board->tick++;
    if (board->faked) {
        memcpy(board->measured_um, board->fake_um, sizeof board->measured_um);
    }
}

static void control_tick(hd_board_t *board)
{
    hd_phasor_t measured_um[HD_MODES], voltage_v[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        measured_um[k] = phasor_of(board->measured_um[k]);
    }
    obey_interlock(board);
    hd_tick(&board->core, (uint32_t)hd_board_t_us(board), measured_um, voltage_v);
    if (board->carrier != NULL) {
        hd_carrier_loop_answer(board->carrier, board->core.drive_hz, voltage_v);
    }
    for (int k = 0; k < HD_MODES; k++) {
        board->voltage_v[k] = complex_of(voltage_v[k]);
    }
}

static void put(double *rows, size_t row, int columns, const double complex *values)
{
    memcpy(rows + 2 * row * (size_t)columns, values, 2 * (size_t)columns * sizeof *rows);
}

static void record(hd_board_t *board, const hd_board_trace_t *trace, size_t row)
{
    double complex reference_um[HD_MODES];
    reference_at_tick(board, reference_um);
    put(trace->reference_um, row, HD_MODES, reference_um);
    put(trace->measured_um, row, HD_MODES, board->measured_um);
    put(trace->plate_um, row, board->plate.modes, board->plate.w_um);
    put(trace->voltage_v, row, HD_MODES, board->voltage_v);
    trace->flags[row] = board->core.tick_flags;
}

size_t hd_board_run(hd_board_t *board, size_t ticks, int32_t fingers, const double *phi,
                    const double *contact_decay_1_s, const double *contact_detuning_rad_s,
                    const hd_board_trace_t *trace, size_t offset, int32_t stop_on_transmit)
{
    size_t shapes = (size_t)fingers * (size_t)board->plate.modes;
    for (size_t i = 0; i < ticks; i++) {
        size_t row = i * (size_t)fingers;
        const double *detuning = contact_detuning_rad_s == NULL ? NULL : contact_detuning_rad_s + row;
        hd_contact_t contact =
            hd_plate_contact(&board->plate, fingers, phi + i * shapes, contact_decay_1_s + row, detuning);
        plate_tick(board, &contact);
        control_tick(board);
        record(board, trace, offset + i);
        if (stop_on_transmit && board->core.pending != 0) {
            return i + 1;
        }
    }
    return ticks;
}
