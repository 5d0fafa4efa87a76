#include "tools.h"

#include <string.h>

#include "reference.h"

/* Written so that NaN is outside. */
static bool within(float value, float low, float high)
{
    return value >= low && value <= high;
}

void hd_tool_init(hd_tool_t *tool, float control_hz, float drive_hz, float v_limit_v)
{
    memset(tool, 0, sizeof *tool);
    tool->control_hz = control_hz;
    tool->drive_hz = drive_hz;
    tool->limit_v = HD_RAW_LIMIT_FRAC * v_limit_v;
    tool->slew_v = tool->limit_v / (control_hz * (float)HD_RAMP_US * 1e-6f);
}

bool hd_sweep_valid(const hd_tool_t *tool, const hd_wire_sweep_t *sweep)
{
    float low_hz = tool->drive_hz - HD_SWEEP_OFFSET_MAX_HZ, high_hz = tool->drive_hz + HD_SWEEP_OFFSET_MAX_HZ;
    return sweep->mode < HD_MODES && within(sweep->start_hz, fmaxf(low_hz, 1.0f), high_hz)
        && within(sweep->stop_hz, fmaxf(low_hz, 1.0f), high_hz) && sweep->points >= 1
        && sweep->points <= HD_SWEEP_POINTS_MAX && sweep->dwell_ms >= HD_SWEEP_DWELL_MIN_MS
        && sweep->dwell_ms <= HD_SWEEP_DWELL_MAX_MS && sweep->voltage_v > 0.0f && sweep->voltage_v <= tool->limit_v;
}

bool hd_raw_voltage_valid(const hd_tool_t *tool, const hd_wire_raw_voltage_t *raw)
{
    return raw->mode < HD_MODES && hd_magnitude((hd_phasor_t){raw->voltage_d_v, raw->voltage_q_v}) <= tool->limit_v
        && raw->duration_ms >= 1 && raw->duration_ms <= HD_RAW_MAX_MS;
}

static void begin_point(hd_tool_t *tool, uint16_t index)
{
    tool->index = index;
    tool->ticks = 0;
    memset(tool->sum_um, 0, sizeof tool->sum_um);
}

void hd_tool_sweep(hd_tool_t *tool, const hd_wire_sweep_t *sweep)
{
    hd_tool_abort(tool);
    tool->kind = HD_TOOL_SWEEP;
    tool->mode = sweep->mode;
    tool->sweep = *sweep;
    tool->goal_v = (hd_phasor_t){sweep->voltage_v, 0.0f};
    uint32_t ticks = (uint32_t)((float)sweep->dwell_ms * 1e-3f * tool->control_hz + 0.5f);
    tool->dwell_ticks = ticks > 2 ? ticks : 2; /* one to settle, one to measure */
    tool->count = 0;
    begin_point(tool, 0);
}

void hd_tool_raw_voltage(hd_tool_t *tool, const hd_wire_raw_voltage_t *raw, uint32_t now_us)
{
    tool->kind = HD_TOOL_RAW;
    tool->mode = raw->mode;
    tool->goal_v = (hd_phasor_t){raw->voltage_d_v, raw->voltage_q_v};
    tool->t_end_us = now_us + raw->duration_ms * 1000u;
}

void hd_tool_stop(hd_tool_t *tool)
{
    tool->goal_v = (hd_phasor_t){0.0f, 0.0f};
    tool->stopping = true;
}

void hd_tool_abort(hd_tool_t *tool)
{
    tool->kind = HD_TOOL_NONE;
    tool->stopping = false;
    tool->goal_v = tool->voltage_v = (hd_phasor_t){0.0f, 0.0f};
}

float hd_tool_drive_hz(const hd_tool_t *tool, float rest_hz)
{
    const hd_wire_sweep_t *sweep = &tool->sweep;
    if (tool->kind != HD_TOOL_SWEEP) {
        return rest_hz;
    }
    float share = sweep->points > 1 ? (float)tool->index / (float)(sweep->points - 1) : 0.0f;
    return sweep->start_hz + share * (sweep->stop_hz - sweep->start_hz);
}

static void slew(hd_tool_t *tool)
{
    hd_phasor_t way_v = hd_sub(tool->goal_v, tool->voltage_v);
    float distance_v = hd_magnitude(way_v);
    tool->voltage_v = distance_v <= tool->slew_v
        ? tool->goal_v
        : hd_add(tool->voltage_v, hd_scale(tool->slew_v / distance_v, way_v));
}

static void push_point(hd_tool_t *tool)
{
    hd_wire_sweep_point_t point = {
        .index = tool->index,
        .points = tool->sweep.points,
        .mode = tool->mode,
        .modes = HD_MODES,
        .frequency_hz = hd_tool_drive_hz(tool, tool->drive_hz),
        .voltage_v = tool->sweep.voltage_v,
    };
    float averaged = (float)(tool->dwell_ticks - tool->dwell_ticks / 2);
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t mean_um = hd_scale(1.0f / averaged, tool->sum_um[k]);
        point.measured[k] = (hd_wire_phasor_t){hd_sendable(mean_um.d), hd_sendable(mean_um.q)};
    }
    if (tool->count == HD_SWEEP_RING) { /* the oldest goes: its index will be missing */
        tool->first = (uint8_t)((tool->first + 1) % HD_SWEEP_RING);
        tool->count--;
    }
    tool->point[(tool->first + tool->count) % HD_SWEEP_RING] = point;
    tool->count++;
}

/* The measurement of a tick was caused by the voltage of the tick before: a point's own begin one tick late. */
static void measure_point(hd_tool_t *tool, const hd_phasor_t measured_um[HD_MODES])
{
    tool->ticks++;
    if (tool->ticks <= tool->dwell_ticks / 2) {
        return;
    }
    for (int k = 0; k < HD_MODES; k++) {
        tool->sum_um[k] = hd_add(tool->sum_um[k], measured_um[k]);
    }
    if (tool->ticks < tool->dwell_ticks) {
        return;
    }
    push_point(tool);
    if (tool->index + 1 < tool->sweep.points) {
        begin_point(tool, (uint16_t)(tool->index + 1));
    } else {
        hd_tool_stop(tool);
    }
}

static bool at_goal(const hd_tool_t *tool)
{
    return tool->voltage_v.d == tool->goal_v.d && tool->voltage_v.q == tool->goal_v.q;
}

bool hd_tool_step(hd_tool_t *tool, uint32_t now_us, const hd_phasor_t measured_um[HD_MODES],
                  hd_phasor_t voltage_v[HD_MODES])
{
    if (tool->kind == HD_TOOL_RAW && !hd_before(now_us, tool->t_end_us)) {
        hd_tool_stop(tool);
    } else if (tool->kind == HD_TOOL_SWEEP && !tool->stopping && at_goal(tool)) {
        measure_point(tool, measured_um);
    }
    slew(tool);
    bool done = tool->stopping && at_goal(tool);
    if (done) {
        hd_tool_abort(tool);
    }
    for (int k = 0; k < HD_MODES; k++) {
        voltage_v[k] = k == tool->mode ? tool->voltage_v : (hd_phasor_t){0.0f, 0.0f};
    }
    return !done;
}

bool hd_tool_pop(hd_tool_t *tool, hd_wire_sweep_point_t *point)
{
    if (tool->count == 0) {
        return false;
    }
    *point = tool->point[tool->first];
    tool->first = (uint8_t)((tool->first + 1) % HD_SWEEP_RING);
    tool->count--;
    return true;
}
