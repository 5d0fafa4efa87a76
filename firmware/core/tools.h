/* Open loop, for a person at the bench: a frequency sweep of one mode, or a raw voltage on one amplifier.
 *
 * No controller holds the amplitude here, so the voltage has a limit of its own, HD_RAW_LIMIT_FRAC of the amplifiers',
 * and never jumps: it moves towards its goal by what takes it from none to that limit in HD_RAMP_US.
 */
#ifndef HD_TOOLS_H
#define HD_TOOLS_H

#include <stdbool.h>
#include <stdint.h>

#include "phasor.h"
#include "protocol.h"

#define HD_SWEEP_RING 8 /* points that the line has not taken yet; one comes every HD_SWEEP_DWELL_MIN_MS or slower */

enum hd_tool_kind {
    HD_TOOL_NONE,
    HD_TOOL_SWEEP,
    HD_TOOL_RAW,
};

typedef struct {
    float control_hz;
    float drive_hz; /* the configured one */
    float limit_v;
    float slew_v; /* largest change per tick */

    uint8_t kind; /* enum hd_tool_kind */
    bool stopping;
    uint8_t mode;
    hd_phasor_t goal_v;
    hd_phasor_t voltage_v;
    uint32_t t_end_us; /* of a raw voltage */

    hd_wire_sweep_t sweep;
    uint16_t index;      /* the point being measured */
    uint32_t ticks;      /* since its frequency was set and its voltage reached */
    uint32_t dwell_ticks;
    hd_phasor_t sum_um[HD_MODES];

    hd_wire_sweep_point_t point[HD_SWEEP_RING];
    uint8_t first;
    uint8_t count;
} hd_tool_t;

void hd_tool_init(hd_tool_t *tool, float control_hz, float drive_hz, float v_limit_v);

/* Whether the figures of a command lie within their bounds. NaN does not. */
bool hd_sweep_valid(const hd_tool_t *tool, const hd_wire_sweep_t *sweep);
bool hd_raw_voltage_valid(const hd_tool_t *tool, const hd_wire_raw_voltage_t *raw);

/* Starts the validated tool; points of an earlier sweep are discarded. */
void hd_tool_sweep(hd_tool_t *tool, const hd_wire_sweep_t *sweep);

/* Begins, or gives a raw voltage that is on another value and more time. */
void hd_tool_raw_voltage(hd_tool_t *tool, const hd_wire_raw_voltage_t *raw, uint32_t now_us);

/* On the ramp to none, or at once. */
void hd_tool_stop(hd_tool_t *tool);
void hd_tool_abort(hd_tool_t *tool);

/* One control tick. Writes the voltages; false, and none of them, when the tool is done. */
bool hd_tool_step(hd_tool_t *tool, uint32_t now_us, const hd_phasor_t measured_um[HD_MODES],
                  hd_phasor_t voltage_v[HD_MODES]);

/* What the oscillator should run at, which is `rest_hz` but for a sweep. */
float hd_tool_drive_hz(const hd_tool_t *tool, float rest_hz);

/* Takes the oldest measured point; false if there is none. */
bool hd_tool_pop(hd_tool_t *tool, hd_wire_sweep_point_t *point);

#endif
