/* The firmware as a process: the shared program (main.c, whose main is renamed for this build) between two open
 * descriptors, with the simulated plate of the reference, sample by sample behind 12-bit converters, in real time.
 *
 *     hapticd-board --line FD --bench FD [--stepped] [--start-us T] [--boot-id N]
 *
 * The bench sees the truth: a report every 2 ms. It may also hold the time: a `stepped` board stands still but for the
 * steps that the bench gives it, and a step first waits for its bytes to come over the line. Then same bytes and steps
 * in, same bytes and reports out. The process ends when another end closes. The chunk interrupt is a part of board_wait
 * here, so nothing has to be locked. Not modelled: fingers, parasitic modes, crosstalk, lags, and noise.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sysexits.h>
#include <time.h>
#include <unistd.h>

#include "board.h"
#include "carrier_loop.h"
#include "sine.h"

_Static_assert(HD_MODES == 2, "the simulated plate has two driven modes");

#define CHUNK_US (HD_CHUNK * 1000000 / HD_SAMPLE_HZ)
#define REPORT_CHUNKS 40
#define CATCH_UP 4000 /* chunks at once, 0.2 s: they take about 20 ms */
#define SLEEP_MS 1 /* at most: two ticks come together */
#define STEPPED_SLEEP_MS 100
#define UNSENT 1024

#define DRIVE_HZ 29205.0
#define V_LIMIT_V 150.0
#define W_LIMIT_UM 4.0
#define TURN_RAD 6.283185307179586

/* The reference plate; its amplifiers hold W_LIMIT_UM with half as much damping again, as fingers bring.
 * hapticd/sim/plate/ground_truth.py has the sources. */
#define QUALITY 500.0
#define SIZED_FOR_DAMPING 1.5
static const double FREQUENCY_HZ[HD_MODES] = {29195.0, 29215.0};

/* From the bench: once `line_bytes` have come over the line, ever, run so many chunks. A step takes 2 kB at most. */
typedef struct HD_PACKED {
    uint32_t line_bytes;
    uint16_t chunks;
} step_t;

/* To the bench, every 2 ms of the board's time and at the end of each step. */
typedef struct HD_PACKED {
    uint32_t t_us;       /* the board's clock */
    uint32_t line_bytes; /* written to the line, ever */
    uint16_t steps;      /* ended, ever */
    hd_wire_phasor_t plate[HD_MODES]; /* in the frame of the nominal drive */
} report_t;

int hd_program(void); /* main.c */

static int line = -1, bench = -1;
static bool stepped, stepping, running_chunks, amplifiers_on;
static uint32_t boot_id, t_us, line_read, line_written, chunks;
static uint16_t steps;
static step_t step;
static size_t step_n; /* bytes of the next step that have come */
static uint8_t unsent[UNSENT]; /* what the line did not take at once */
static size_t unsent_n;
static hd_carrier_loop_t loop; /* its carrier is not used: the program has one */

static uint32_t clock_us(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint32_t)((uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u);
}

/* Full scale: amplifiers at 1800 steps, and half as much again as the amplitude that latches a fault. The model is the
 * plate as measured by a sweep. */
void board_start(hd_config_t *config, hd_converters_t *converters)
{
    double decay_1_s[HD_MODES], detuning_rad_s[HD_MODES], gain_um_per_v_s[HD_MODES], gains[HD_MODES * HD_MODES] = {0};
    double loop_phase_rad[HD_MODES], w_limit_um[HD_MODES];
    const double sensor[HD_MODES * HD_MODES] = {1.0, 0.0, 0.0, 1.0};
    for (int k = 0; k < HD_MODES; k++) {
        decay_1_s[k] = 0.5 * TURN_RAD * FREQUENCY_HZ[k] / QUALITY;
        detuning_rad_s[k] = TURN_RAD * (FREQUENCY_HZ[k] - DRIVE_HZ);
        double held_1_s = hypot(SIZED_FOR_DAMPING * decay_1_s[k], detuning_rad_s[k]);
        gains[k * HD_MODES + k] = gain_um_per_v_s[k] = W_LIMIT_UM * held_1_s / V_LIMIT_V;
        loop_phase_rad[k] = -0.5 * TURN_RAD * DRIVE_HZ / HD_SAMPLE_HZ; /* a sample is held for a microsecond */
        w_limit_um[k] = W_LIMIT_UM;
    }
    const hd_converter_setup_t lossless = {.volts_per_lsb = V_LIMIT_V / 1800.0, .um_per_lsb = 9.0 / 2048.0};
    const hd_board_setup_t setup = {
        .plate_modes = HD_MODES, .decay_1_s = decay_1_s, .detuning_rad_s = detuning_rad_s, .gain_um_per_v_s = gains,
        .sensor = sensor, .amplifier_limit_v = V_LIMIT_V, .converters = &lossless, .boot_id = boot_id,
        .control_hz = 2000.0, .drive_hz = DRIVE_HZ, .v_limit_v = V_LIMIT_V, .w_limit_um = w_limit_um,
        .nominal_decay_1_s = decay_1_s, .nominal_detuning_rad_s = detuning_rad_s,
        .nominal_gain_um_per_v_s = gain_um_per_v_s, .nominal_loop_phase_rad = loop_phase_rad,
        .law = HD_LAW_DEADBEAT, .reset_cause = HD_RESET_POWER,
    };
    const hd_contact_t untouched = {.stiffest_1_s = 0.0};
    *config = hd_board_config(&setup);
    *converters = hd_board_converters(&setup);
    hd_carrier_loop_init(&loop, &setup);
    hd_carrier_plate_touch(&loop.plate, &untouched);
    t_us = stepped ? t_us : clock_us();
}

static void report(void)
{
    /* The core's oscillator starts with the first sample. */
    uint32_t phase = chunks * HD_CHUNK * hd_oscillator_step((float)DRIVE_HZ);
    report_t said = {t_us, line_written, steps, {{0.0f, 0.0f}}};
    for (int k = 0; k < HD_MODES; k++) {
        double complex w_um = hd_carrier_plate_amplitude_um(&loop.plate, k, TURN_RAD * DRIVE_HZ, phase);
        said.plate[k] = (hd_wire_phasor_t){(float)creal(w_um), (float)cimag(w_um)};
    }
    if (write(bench, &said, sizeof said) < 0 && errno == EPIPE) {
        exit(EXIT_SUCCESS);
    }
}

/* The first report signals to the bench that the board runs. */
void board_run(void)
{
    report();
}

/* Never ahead of the samples: an instant that the main program gives must not lie behind the next tick's. */
uint32_t board_now_us(void)
{
    uint32_t since_us = stepped || running_chunks ? 0 : clock_us() - t_us;
    return t_us + (since_us < CHUNK_US ? since_us : CHUNK_US);
}

/* In a step all of its bytes at once, for what the main loop answers depends on how they are grouped. */
size_t board_read(uint8_t *bytes, size_t capacity)
{
    int waiting = 0;
    ioctl(line, FIONREAD, &waiting);
    if (stepped && !(stepping && line_read + (uint32_t)waiting == step.line_bytes)) {
        return 0;
    }
    ssize_t n = read(line, bytes, capacity);
    if (n == 0) {
        exit(EXIT_SUCCESS);
    }
    line_read += n > 0 ? (uint32_t)n : 0;
    return n > 0 ? (size_t)n : 0;
}

size_t board_write_room(void)
{
    ssize_t n = unsent_n > 0 ? write(line, unsent, unsent_n) : 0;
    if (n > 0) {
        unsent_n -= (size_t)n;
        memmove(unsent, unsent + n, unsent_n);
    }
    return UNSENT - unsent_n;
}

void board_write(const uint8_t *bytes, size_t n)
{
    memcpy(unsent + unsent_n, bytes, n);
    unsent_n += n;
    line_written += (uint32_t)n;
    board_write_room();
}

void board_enable_amplifiers(bool enable)
{
    amplifiers_on = enable;
}

void board_sync(bool high)
{
    (void)high;
}

bool board_set_baud(uint32_t baud)
{
    (void)baud;
    return true;
}

uint8_t board_interlock(void)
{
    return 0;
}

void board_lock(void)
{
}

void board_unlock(void)
{
}

void board_feed_watchdog(void)
{
}

void board_keep_log(const hd_log_t *log)
{
    (void)log;
}

/* Plays a chunk and samples the plate. */
static void run_chunk(void)
{
    if (!amplifiers_on) {
        hd_carrier_loop_rest(loop.playing);
    }
    running_chunks = true;
    hd_carrier_loop_play(&loop);
    t_us += CHUNK_US;
    hd_on_chunk(loop.sampled, loop.next);
    running_chunks = false;
    if (++chunks % REPORT_CHUNKS == 0) {
        report();
    }
}

/* A computer that was busy elsewhere for longer skips the rest of that time, in which the plate stood still. */
static void run_due_chunks(void)
{
    uint32_t due = (clock_us() - t_us) / CHUNK_US;
    uint32_t skipped = due > CATCH_UP ? due - CATCH_UP : 0;
    t_us += skipped * CHUNK_US;
    for (due -= skipped; due > 0; due--) {
        run_chunk();
    }
}

static void read_bench(void)
{
    ssize_t n = stepping ? -1 : read(bench, (uint8_t *)&step + step_n, sizeof step - step_n);
    if (n == 0) {
        exit(EXIT_SUCCESS);
    }
    step_n = n > 0 ? step_n + (size_t)n : step_n;
    stepping = stepping || (stepped && step_n == sizeof step);
    step_n = step_n == sizeof step ? 0 : step_n;
}

static void sleep_until_something_comes(int timeout_ms)
{
    struct pollfd ports[] = {
        {.fd = line, .events = (short)(POLLIN | (unsent_n > 0 ? POLLOUT : 0))},
        {.fd = bench, .events = POLLIN},
    };
    poll(ports, sizeof ports / sizeof *ports, timeout_ms);
    if (ports[1].revents != 0) {
        read_bench();
    }
}

void board_wait(void)
{
    if (!stepped) {
        sleep_until_something_comes(SLEEP_MS);
        run_due_chunks();
    } else if (!stepping || line_read != step.line_bytes) {
        sleep_until_something_comes(STEPPED_SLEEP_MS);
    } else if (step.chunks > 0) {
        step.chunks--;
        run_chunk();
    } else { /* and the output of the last chunk was sent */
        stepping = false;
        steps++;
        report();
    }
}

int main(int count, char **words)
{
    static const char *const numbers[] = {"--line", "--bench", "--start-us", "--boot-id"};
    uint32_t values[] = {UINT32_MAX, UINT32_MAX, 0, 1};
    for (int i = 1; i < count; i++) {
        for (int k = 0; k < 4 && i + 1 < count; k++) {
            if (strcmp(words[i], numbers[k]) == 0) {
                values[k] = (uint32_t)strtoul(words[++i], NULL, 0);
            }
        }
        stepped = stepped || strcmp(words[i], "--stepped") == 0;
    }
    line = (int)values[0], bench = (int)values[1], t_us = values[2], boot_id = values[3];
    if (fcntl(line, F_SETFL, O_NONBLOCK) != 0 || fcntl(bench, F_SETFL, O_NONBLOCK) != 0) {
        fprintf(stderr, "usage: hapticd-board --line FD --bench FD [--stepped] [--start-us T] [--boot-id N]\n");
        return EX_USAGE;
    }
    signal(SIGPIPE, SIG_IGN);
    return hd_program();
}
