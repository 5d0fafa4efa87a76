#include "carrier_loop.h"

#include <math.h>
#include <string.h>

#define TWO_PI 6.283185307179586
#define LAG_MIN_US 0.1 /* a shorter one would be lost in the rounding of the plate's exponential; 0 is none */

static bool converters_valid(const hd_converter_setup_t *converters)
{
    double lag_us = converters->amplifier_lag_us;
    return isfinite(converters->offset_lsb) && converters->noise_lsb >= 0.0 && isfinite(converters->noise_lsb)
        && (lag_us == 0.0 || (lag_us >= LAG_MIN_US && isfinite(lag_us)));
}

static void set_up_plate(hd_carrier_plate_t *plate, const hd_board_setup_t *setup)
{
    plate->modes = setup->plate_modes;
    plate->drive_rad_s = TWO_PI * setup->drive_hz;
    plate->amplifier_limit_v = setup->amplifier_limit_v;
    plate->amplifier_lag_s = setup->converters->amplifier_lag_us * 1e-6;
    for (int p = 0; p < plate->modes; p++) {
        plate->resonance_rad_s[p] = plate->drive_rad_s + setup->detuning_rad_s[p];
        plate->decay_1_s[p] = setup->decay_1_s[p];
        for (int k = 0; k < HD_MODES; k++) {
            plate->gain_um_per_v_s[p][k] = setup->gain_um_per_v_s[p * HD_MODES + k];
            plate->sensor[k][p] = setup->sensor[k * plate->modes + p];
        }
    }
}

void hd_carrier_loop_rest(uint16_t chunk[HD_CHUNK][HD_MODES])
{
    for (int i = 0; i < HD_CHUNK; i++) {
        for (int k = 0; k < HD_MODES; k++) {
            chunk[i][k] = HD_MID_RAIL;
        }
    }
}

hd_converters_t hd_board_converters(const hd_board_setup_t *setup)
{
    hd_converters_t converters = {.drive_hz = (float)setup->drive_hz, .control_hz = (float)setup->control_hz};
    for (int k = 0; k < HD_MODES; k++) {
        converters.volts_per_lsb[k] = (float)setup->converters->volts_per_lsb;
        converters.um_per_lsb[k] = (float)setup->converters->um_per_lsb;
    }
    return converters;
}

bool hd_carrier_loop_init(hd_carrier_loop_t *loop, const hd_board_setup_t *setup)
{
    memset(loop, 0, sizeof *loop);
    loop->converters = *setup->converters;
    loop->random = setup->seed;
    for (int k = 0; k < HD_MODES; k++) {
        loop->lead[k] =
            (hd_lead_t){.offset_lsb = setup->converters->offset_lsb, .noise_lsb = setup->converters->noise_lsb};
    }
    hd_converters_t converters = hd_board_converters(setup);
    set_up_plate(&loop->plate, setup);
    hd_carrier_loop_rest(loop->playing);
    hd_carrier_loop_rest(loop->next);
    return converters_valid(setup->converters) && hd_carrier_init(&loop->carrier, &converters);
}

static double through_lead(const hd_carrier_loop_t *loop, int k, double sensed_um)
{
    const hd_lead_t *lead = &loop->lead[k];
    double steps = sensed_um / loop->converters.um_per_lsb + lead->pickup_lsb_per_v * loop->played_v;
    if (lead->clip_lsb > 0.0) {
        steps = fmin(fmax(steps, -lead->clip_lsb), lead->clip_lsb);
    }
    if (lead->hum_lsb > 0.0) {
        steps += lead->hum_lsb * sin(TWO_PI * lead->hum_hz * (double)loop->samples / HD_SAMPLE_HZ + k);
    }
    return steps;
}

static void sample(hd_carrier_loop_t *loop, uint16_t in[HD_MODES])
{
    double sensed_um[HD_MODES];
    hd_carrier_plate_sense(&loop->plate, sensed_um);
    for (int k = 0; k < HD_MODES; k += 2) {
        double most_lsb = fmax(loop->lead[k].noise_lsb, k + 1 < HD_MODES ? loop->lead[k + 1].noise_lsb : 0.0);
        double complex noise = most_lsb > 0.0 ? hd_random_normal(&loop->random) : 0.0;
        const double deviates[2] = {creal(noise), cimag(noise)};
        for (int i = 0; i < 2 && k + i < HD_MODES; i++) {
            const hd_lead_t *lead = &loop->lead[k + i];
            double steps =
                through_lead(loop, k + i, sensed_um[k + i]) + lead->offset_lsb + lead->noise_lsb * deviates[i];
            double code = fmin(fmax(floor(steps + 2048.5), 0.0), 4095.0);
            in[k + i] = (uint16_t)code;
        }
    }
    loop->samples++;
}

void hd_carrier_loop_play(hd_carrier_loop_t *loop)
{
    for (int i = 0; i < HD_CHUNK; i++) {
        double voltage_v[HD_MODES];
        sample(loop, loop->sampled[i]);
        for (int k = 0; k < HD_MODES; k++) {
            voltage_v[k] = (loop->playing[i][k] - 2048) * loop->converters.volts_per_lsb;
        }
        hd_carrier_plate_advance(&loop->plate, voltage_v);
        loop->played_v = 0.0;
        for (int k = 0; k < HD_MODES; k++) {
            loop->played_v += voltage_v[k];
        }
    }
    memcpy(loop->playing, loop->next, sizeof loop->playing);
}

void hd_carrier_loop_listen(hd_carrier_loop_t *loop, const hd_contact_t *contact, hd_phasor_t measured_um[HD_MODES])
{
    hd_carrier_plate_touch(&loop->plate, contact);
    hd_carrier_loop_play(loop);
    while (!hd_carrier_listen(&loop->carrier, loop->sampled)) {
        hd_carrier_speak(&loop->carrier, loop->next);
        hd_carrier_loop_play(loop);
    }
    hd_carrier_measure(&loop->carrier, measured_um);
}

void hd_carrier_loop_answer(hd_carrier_loop_t *loop, float drive_hz, const hd_phasor_t voltage_v[HD_MODES])
{
    hd_carrier_tune(&loop->carrier, drive_hz);
    hd_carrier_drive(&loop->carrier, voltage_v);
    hd_carrier_speak(&loop->carrier, loop->next);
}

double complex hd_carrier_loop_amplitude_um(const hd_carrier_loop_t *loop, int p)
{
    hd_oscillation_t now = loop->carrier.played[0];
    return hd_carrier_plate_amplitude_um(&loop->plate, p, TWO_PI * HD_SAMPLE_HZ * now.step / 0x1p32, now.phase);
}
