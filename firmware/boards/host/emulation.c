#include "emulation.h"

#include <string.h>

#include "sine.h"

_Static_assert(HD_MODES == 2, "the simulated plate has two driven modes");

#define REPORT_CHUNKS 40

#define DRIVE_HZ 29205.0f
#define CONTROL_HZ 2000.0f
#define V_LIMIT_V 150.0f
#define W_LIMIT_UM 4.0f
#define TURN_RAD 6.28318531f

/* Full scale: amplifiers of 150 V at 1800 steps, and half as much again as the amplitude that latches a fault. */
#define VOLTS_PER_LSB (V_LIMIT_V / 1800.0f)
#define UM_PER_LSB (9.0f / 2048.0f)

/* The reference plate; its amplifiers hold W_LIMIT_UM with half as much damping again, as fingers bring.
 * hapticd/sim/plate.py has the sources. */
#define QUALITY 500.0f
#define SIZED_FOR_DAMPING 1.5f
static const float FREQUENCY_HZ[HD_MODES] = {29195.0f, 29215.0f};

static hd_resonance_t resonance_of(int mode)
{
    float decay_1_s = 0.5f * TURN_RAD * FREQUENCY_HZ[mode] / QUALITY;
    hd_phasor_t held = {SIZED_FOR_DAMPING * decay_1_s, TURN_RAD * (FREQUENCY_HZ[mode] - DRIVE_HZ)};
    return (hd_resonance_t){
        .frequency_hz = FREQUENCY_HZ[mode], .decay_1_s = decay_1_s,
        .gain_um_per_v_s = W_LIMIT_UM * hd_magnitude(held) / V_LIMIT_V, .amplifier_limit_v = V_LIMIT_V,
    };
}

/* A sample is held for a microsecond, so what the plate gets is on average half of one late. */
static hd_phasor_t half_a_sample_late(void)
{
    hd_phasor_t ahead = hd_unit_phasor(hd_oscillator_step(DRIVE_HZ) / 2);
    return (hd_phasor_t){ahead.d, -ahead.q};
}

static void rest(uint16_t out[HD_CHUNK][HD_MODES])
{
    for (int n = 0; n < HD_CHUNK; n++) {
        for (int k = 0; k < HD_MODES; k++) {
            out[n][k] = HD_MID_RAIL;
        }
    }
}

void hd_emulation_start(hd_emulation_t *board, const hd_emulation_options_t *options, hd_config_t *config,
                        hd_converters_t *converters)
{
    memset(board, 0, sizeof *board);
    *converters = (hd_converters_t){.drive_hz = DRIVE_HZ, .control_hz = CONTROL_HZ};
    *config = (hd_config_t){
        .boot_id = options->boot_id, .control_hz = CONTROL_HZ, .drive_hz = DRIVE_HZ, .v_limit_v = V_LIMIT_V,
        .gains = {.law = HD_LAW_DEADBEAT}, .output_delay_frac = HD_CHUNK * CONTROL_HZ / HD_SAMPLE_HZ,
        .reset_cause = HD_RESET_POWER,
    };
    hd_resonance_t resonance[HD_MODES];
    hd_phasor_t loop = half_a_sample_late();
    for (int k = 0; k < HD_MODES; k++) {
        converters->volts_per_lsb[k] = VOLTS_PER_LSB;
        converters->um_per_lsb[k] = UM_PER_LSB;
        config->w_limit_um[k] = W_LIMIT_UM;
        resonance[k] = resonance_of(k);
        float detuning_rad_s = TURN_RAD * (FREQUENCY_HZ[k] - DRIVE_HZ);
        config->model[k] = (hd_mode_model_t){
            resonance[k].decay_1_s, detuning_rad_s, resonance[k].gain_um_per_v_s, loop,
        };
    }
    hd_resonators_init(&board->plate, resonance, converters);
    rest(board->out[0]);
    rest(board->out[1]);
    board->t_us = options->t_start_us;
    board->stepped = options->stepped != 0;
}

uint32_t hd_emulation_due(hd_emulation_t *board, uint32_t clock_us, uint32_t most)
{
    uint32_t due = (clock_us - board->t_us) / HD_CHUNK_US;
    if (due > most) {
        board->t_us += (due - most) * HD_CHUNK_US;
        due = most;
    }
    return due;
}

uint32_t hd_emulation_now_us(const hd_emulation_t *board, uint32_t clock_us)
{
    uint32_t since_us = clock_us - board->t_us;
    return board->t_us + (since_us < HD_CHUNK_US ? since_us : HD_CHUNK_US);
}

bool hd_emulation_chunk(hd_emulation_t *board)
{
    uint16_t(*playing)[HD_MODES] = board->out[board->chunks % 2];
    if (!board->amplifiers_on) {
        rest(playing);
    }
    hd_resonators_play(&board->plate, playing, board->in);
    board->chunks++;
    board->t_us += HD_CHUNK_US;
    hd_on_chunk(board->in, playing); /* its turn comes again after the other's */
    return board->chunks % REPORT_CHUNKS == 0;
}

bool hd_emulation_may_read(const hd_emulation_t *board, uint32_t arrived)
{
    return !board->stepped || (board->stepping && arrived == board->step.line_bytes);
}

void hd_emulation_hear(hd_emulation_t *board, uint8_t byte)
{
    if (!board->stepped || board->stepping) {
        return; /* a bench that does not wait for the end of a step is broken */
    }
    board->step_bytes[board->step_n++] = byte;
    if (board->step_n == sizeof board->step) {
        memcpy(&board->step, board->step_bytes, sizeof board->step);
        board->step_n = 0;
        board->stepping = true;
    }
}

enum hd_turn hd_emulation_turn(hd_emulation_t *board)
{
    if (!board->stepping || board->line_read != board->step.line_bytes) {
        return HD_TURN_WAITS;
    }
    if (board->step.chunks == 0) { /* and what the last chunk had to say has been said */
        board->stepping = false;
        board->steps++;
        return HD_TURN_REPORTS;
    }
    board->step.chunks--;
    return hd_emulation_chunk(board) ? HD_TURN_REPORTS : HD_TURN_GOES_ON;
}

hd_bench_report_t hd_emulation_report(const hd_emulation_t *board)
{
    /* The core's oscillator starts with the first sample. */
    hd_phasor_t oscillator = hd_unit_phasor(board->chunks * HD_CHUNK * hd_oscillator_step(DRIVE_HZ));
    hd_bench_report_t report = {board->t_us, board->line_written, board->steps, {{0.0f, 0.0f}}};
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t w_um = hd_resonators_amplitude_um(&board->plate, k, oscillator);
        report.plate[k] = (hd_wire_phasor_t){w_um.d, w_um.q};
    }
    return report;
}
