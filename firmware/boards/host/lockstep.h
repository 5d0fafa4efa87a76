/* The firmware's core and a simulated plate in one virtual time, as a flat C interface for a foreign caller.
 *
 * The board stands at an instant: the last tick's. Bytes come and go then or before the next one; hd_board_run moves
 * the plate on by a tick and performs the tick at its end, again and again. Same calls, same results, to the last bit.
 * The plate is seen as envelopes, or sample by sample behind the firmware's carrier (carrier_loop.h): the same calls.
 * Arrays are C-contiguous doubles, complex numbers stand as (real, imaginary) pairs.
 */
#ifndef HD_LOCKSTEP_H
#define HD_LOCKSTEP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "core.h"

typedef struct hd_board hd_board_t;

/* The converters of a board whose carrier is simulated, the same for every mode. */
typedef struct {
    double volts_per_lsb;
    double um_per_lsb;
    double offset_lsb; /* of what the ADC gives at rest from mid-rail */
    double noise_lsb;  /* standard deviation, per sample */
    double amplifier_lag_us;
} hd_converter_setup_t;

/* What stands between a sensor and its converter, only with a carrier. The converters' offset and noise are its own then. */
typedef struct {
    double offset_lsb;
    double noise_lsb;
    double hum_lsb; /* of the mains, at hum_hz */
    double hum_hz;
    double clip_lsb; /* the preamplifier's range to either side of its middle; 0: as far as the converter's */
    double pickup_lsb_per_v; /* of the voltages of all amplifiers together */
} hd_lead_t;

typedef struct {
    /* the plate's truth */
    int32_t plate_modes;
    const double *decay_1_s;       /* (P,) */
    const double *detuning_rad_s;  /* (P,) */
    const double *gain_um_per_v_s; /* (P, HD_MODES) */
    const double *sensor;          /* (HD_MODES, P) real part */
    const double *sensor_imaginary; /* (HD_MODES, P), only of envelopes; or NULL: 0 */
    const double *loop_phase_rad;  /* (HD_MODES,) what amplifier, electrodes and sensor add to each loop */
    const double *through_um_per_v; /* (HD_MODES sensors, HD_MODES amplifiers) complex: what a voltage adds; or NULL */
    double noise_um;
    double amplifier_limit_v;
    uint64_t seed;
    const hd_converter_setup_t *converters; /* sample by sample, with neither loop_phase_rad nor noise_um; NULL: envelopes */
    /* the board's configuration */
    uint64_t t_start_us;
    uint32_t boot_id;
    double control_hz;
    double drive_hz;
    double v_limit_v;
    const double *w_limit_um;               /* (HD_MODES,) */
    const double *nominal_decay_1_s;        /* (HD_MODES,) */
    const double *nominal_detuning_rad_s;   /* (HD_MODES,) */
    const double *nominal_gain_um_per_v_s;  /* (HD_MODES,) */
    const double *nominal_loop_phase_rad;   /* (HD_MODES,) */
    const double *drive;                    /* (HD_MODES amplifiers, HD_MODES modes); NULL: each mode its own */
    const double *sense;                    /* (HD_MODES modes, HD_MODES sensors) complex; or NULL, as above */
    const double *feedthrough_um_per_v;     /* (HD_MODES modes, HD_MODES amplifiers) complex; NULL: none */
    int32_t law;
    double bandwidth_1_s;
    double integral_time_s;
    int32_t latch_repeated_trips;
    int32_t reset_cause; /* enum hd_reset_cause */
    int32_t has_sync;
    uint32_t baud_max;
    uint32_t image_crc;
} hd_board_setup_t;

/* One row per tick. */
typedef struct {
    double *reference_um; /* (T, HD_MODES) complex: reference at the tick, after ramps and limits */
    double *measured_um;  /* (T, HD_MODES) complex: what the core was given */
    double *plate_um;     /* (T, P) complex: the truth at the tick */
    double *voltage_v;    /* (T, HD_MODES) complex: what the core answered */
    uint8_t *flags;       /* (T,) enum hd_tick_flag */
} hd_board_trace_t;

/* What the core of such a board is configured with. */
hd_config_t hd_board_config(const hd_board_setup_t *setup);

int32_t hd_board_modes(void);
size_t hd_board_setup_size(void); /* for the caller to compare with its own idea of the structure */

/* NULL if memory is short or the setup makes no sense. */
hd_board_t *hd_board_new(const hd_board_setup_t *setup);
void hd_board_free(hd_board_t *board);

/* Resets the processor, as by its watchdog or reset pin: another boot, a clock from 0, no voltage. The plate
 * goes on from where it is. */
void hd_board_reset(hd_board_t *board, uint32_t boot_id, int32_t cause);

uint64_t hd_board_t_us(const hd_board_t *board); /* not wrapped */
void hd_board_skip(hd_board_t *board, uint64_t ticks); /* their time passes, but neither plate nor core moves */
void hd_board_receive(hd_board_t *board, const uint8_t *bytes, size_t n, uint64_t at_us);
size_t hd_board_transmit(hd_board_t *board, uint8_t *out, size_t capacity, uint64_t at_us);

/* Performs up to `ticks` ticks; row i of phi (ticks, fingers, P), contact_decay_1_s (ticks, fingers) and, unless it is
 * NULL, contact_detuning_rad_s (ticks, fingers; only of envelopes) holds for the time that leads to tick i. Writes trace rows from `offset` on. With `stop_on_transmit`, ends after the tick that has
 * something to send. Returns the ticks performed. */
size_t hd_board_run(hd_board_t *board, size_t ticks, int32_t fingers, const double *phi,
                    const double *contact_decay_1_s, const double *contact_detuning_rad_s,
                    const hd_board_trace_t *trace, size_t offset, int32_t stop_on_transmit);

/* Leads (HD_MODES,) from now on. Returns false without a carrier. */
bool hd_board_leads(hd_board_t *board, const hd_lead_t *leads);

/* The event that forbids to drive from now on, as board_interlock of board.h; 0: none. */
void hd_board_interlock(hd_board_t *board, uint8_t event);

/* The speed that the host has asked for; 0: none, or not any more. */
uint32_t hd_board_baud(hd_board_t *board);

/* What the observer has learned of each mode: (HD_MODES, 2), decay in 1/s and detuning in rad/s. */
void hd_board_estimate(const hd_board_t *board, double *estimate);

/* Gives the plate's modes other detunings (P,), from the configured drive; only of envelopes. */
void hd_board_detune(hd_board_t *board, const double *detuning_rad_s);

/* Overrides the sensors from now on; NaN is permitted. NULL restores the plate's measurement. */
void hd_board_fake_measurement(hd_board_t *board, const double *measured_um);

#endif
