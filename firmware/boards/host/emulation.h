/* What boards without a plate have in common: converters that play and sample the simulated one, chunk by chunk, and the
 * bench behind a second port.
 *
 * The bench sees the truth: a report every 2 ms. It may also hold the time: a board that was started `stepped` stands
 * still but for the steps that the bench gives it, and a step first waits for its bytes to come over the line. Then
 * same bytes and steps in, same bytes and reports out, on a slow machine as on a fast one.
 */
#ifndef HD_EMULATION_H
#define HD_EMULATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board.h"
#include "resonators.h"

#define HD_CHUNK_US (HD_CHUNK * 1000000 / HD_SAMPLE_HZ)

/* To the board: once `line_bytes` have come over the line, ever, run so many chunks. A step takes 2 kB at most. */
typedef struct HD_PACKED {
    uint32_t line_bytes;
    uint16_t chunks;
} hd_bench_step_t;

/* From the board, every 2 ms of its time and at the end of each step. */
typedef struct HD_PACKED {
    uint32_t t_us;       /* the board's clock */
    uint32_t line_bytes; /* written to the line, ever */
    uint16_t steps;      /* ended, ever */
    hd_wire_phasor_t plate[HD_MODES]; /* in the frame of the nominal drive */
} hd_bench_report_t;

/* How a board is started; all zero is how it starts by itself. */
typedef struct {
    uint32_t boot_id;
    uint32_t t_start_us;
    uint32_t stepped;
} hd_emulation_options_t;

typedef struct {
    hd_resonators_t plate;
    uint16_t in[HD_CHUNK][HD_MODES];
    uint16_t out[2][HD_CHUNK][HD_MODES]; /* one is played while the other is made */
    uint32_t chunks;                     /* played, ever */
    uint32_t t_us;
    bool amplifiers_on;

    bool stepped;
    uint8_t step_bytes[sizeof(hd_bench_step_t)];
    size_t step_n;
    hd_bench_step_t step;
    bool stepping;
    uint16_t steps;
    uint32_t line_read, line_written;
} hd_emulation_t;

/* Fills in what the board believes, which is the simulated plate as a sweep would find it. */
void hd_emulation_start(hd_emulation_t *board, const hd_emulation_options_t *options, hd_config_t *config,
                        hd_converters_t *converters);

/* How many chunks are due by the board's clock, `most` at most: a computer that was busy elsewhere for longer skips the
 * rest of that time, in which the plate stood still. */
uint32_t hd_emulation_due(hd_emulation_t *board, uint32_t clock_us, uint32_t most);

/* Never ahead of the samples: an instant that the main program gives must not lie behind the next tick's. */
uint32_t hd_emulation_now_us(const hd_emulation_t *board, uint32_t clock_us);

/* Plays a chunk, samples the plate and calls hd_on_chunk; true if a report is due. */
bool hd_emulation_chunk(hd_emulation_t *board);

/* Whether the main loop may see the line's bytes, of which `arrived` have come, ever: in a step all at once, for what it
 * answers depends on how they are grouped. */
bool hd_emulation_may_read(const hd_emulation_t *board, uint32_t arrived);

/* A byte from the bench. */
void hd_emulation_hear(hd_emulation_t *board, uint8_t byte);

enum hd_turn {
    HD_TURN_WAITS,   /* for the bench or for the line */
    HD_TURN_GOES_ON, /* a chunk was run: let the main loop come round */
    HD_TURN_REPORTS, /* the same, and a report is due */
};

/* What a stepped board does when its main loop has come round. */
enum hd_turn hd_emulation_turn(hd_emulation_t *board);

hd_bench_report_t hd_emulation_report(const hd_emulation_t *board);

#endif
