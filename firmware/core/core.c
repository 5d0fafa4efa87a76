#include "core.h"

#include <string.h>

#include "limiter.h"
#include "plausibility.h"
#include "reach_watch.h"
#include "states.h"

/* A limit in V or um, or a frequency: its square, and that of a hundredth of it, neither overflow nor underflow. */
static bool sensible(float value)
{
    return value >= 1e-6f && value <= 1e6f;
}

bool hd_model_valid(const hd_mode_model_t *model)
{
    return model->decay_1_s >= HD_DECAY_MIN_1_S && model->decay_1_s <= HD_DECAY_MAX_1_S
        && fabsf(model->detuning_rad_s) <= HD_DETUNING_MAX_RAD_S && model->gain_um_per_v_s >= HD_GAIN_MIN_UM_PER_V_S
        && model->gain_um_per_v_s <= HD_GAIN_MAX_UM_PER_V_S
        && fabsf(hd_magnitude(model->loop) - 1.0f) <= HD_LOOP_TOLERANCE;
}

static bool config_valid(const hd_config_t *config)
{
    bool valid = config->control_hz >= 500.0f && config->control_hz <= 50000.0f && sensible(config->drive_hz)
        && sensible(config->v_limit_v) && hd_gains_valid(&config->gains)
        && config->output_delay_frac >= 0.0f && config->output_delay_frac <= 1.0f;
    for (int k = 0; k < HD_MODES; k++) {
        valid = valid && sensible(config->w_limit_um[k]) && hd_model_valid(&config->model[k]);
    }
    return valid && hd_wiring_valid(&config->wiring);
}

bool hd_init(hd_core_t *core, const hd_config_t *config, uint32_t now_us)
{
    memset(core, 0, sizeof *core);
    core->config = *config;
    core->config.gains = hd_gains_complete(config->gains, 1.0f / config->control_hz);
    hd_wiring_complete(&core->config.wiring);
    core->t_status_us = core->t_reached_us = now_us;
    core->state = HD_STATE_FAULT;
    hd_log_recover(&core->config.log);
    hd_deadman_reset(&core->deadman);
    if (!config_valid(&core->config)) { /* the board still answers: with figures that a host can read, all 0 */
        core->fault = HD_FAULT_CONFIG;
        core->config = (hd_config_t){
            .boot_id = config->boot_id, .reset_cause = config->reset_cause, .image_crc = config->image_crc,
            .log = core->config.log,
        };
        return false;
    }
    core->state = HD_STATE_QUIET;
    hd_follow_init(&core->follower, config->drive_hz, config->control_hz);
    core->ramp_ticks = (uint16_t)(config->control_hz * (float)HD_RAMP_US * 1e-6f);
    hd_plausibility_init(core);
    hd_reach_init(core);
    hd_design_t *design = &core->staged.design;
    design->gains = core->config.gains;
    design->plant.tick_s = 1.0f / config->control_hz;
    design->plant.output_delay_frac = config->output_delay_frac;
    memcpy(design->plant.model, config->model, sizeof config->model);
    design->plant.wiring = core->config.wiring;
    hd_control_design(design);
    hd_control_adopt(&core->control, design);
    hd_tool_init(&core->tool, config->control_hz, config->drive_hz, config->v_limit_v);
    hd_memory_init(core);
    hd_silence(core);
    return true;
}

static void watch_plate(hd_core_t *core, uint32_t now_us)
{
    hd_reach_watch(core, now_us);
    enum hd_fault fault = hd_implausible(core);
    if (fault != HD_FAULT_NONE) {
        hd_fail(core, fault, core->control.turn, hd_magnitude(core->measured_um[core->control.turn]), now_us);
    }
}

/* Before anything drives. */
static void watch_memory(hd_core_t *core, uint32_t now_us)
{
    int k = core->control.turn;
    hd_phasor_t reference_um = core->reference_um[k];
    enum hd_damage damage = HD_DAMAGE_NONE;
    if (hd_inverted(core->config.v_limit_v) != core->settled.v_limit_inverted) {
        damage = HD_DAMAGE_VOLTAGE_LIMIT;
    } else if (!(hd_dot(reference_um, reference_um) <= core->settled.w_limit_um2[k])) {
        damage = HD_DAMAGE_REFERENCE;
    } else if (hd_sweeps_core(&core->sweep)) {
        damage = hd_memory_sweep(core);
    }
    core->sweep.ticks++;
    if (damage != HD_DAMAGE_NONE) {
        hd_lose_memory(core, damage, now_us);
    }
}

/* Mean of an amplifier's voltage over the tick just ended: the last one held for all but the board's delay. */
static hd_phasor_t mean_voltage_v(const hd_core_t *core, int k)
{
    hd_phasor_t newest_v = core->voltage_v[k];
    return hd_add(newest_v, hd_scale(core->config.output_delay_frac, hd_sub(core->previous_v[k], newest_v)));
}

/* What is not finite counts as 0, and is a fault. */
static hd_phasor_t believed_um(hd_core_t *core, int k, hd_phasor_t value_um, uint32_t now_us)
{
    if (hd_finite(value_um)) {
        return value_um;
    }
    hd_fail(core, HD_FAULT_MEASUREMENT_NOT_FINITE, k, 0.0f, now_us);
    return (hd_phasor_t){0.0f, 0.0f};
}

/* The modes' amplitudes, where they are not the sensors'. */
static void mix(hd_core_t *core, uint32_t now_us)
{
    hd_phasor_t mean_v[HD_MODES];
    for (int k = 0; k < HD_MODES; k++) {
        mean_v[k] = mean_voltage_v(core, k);
    }
    memcpy(core->previous_v, core->voltage_v, sizeof core->previous_v);
    hd_wiring_sense(&core->control.design.plant.wiring, core->sensor_um, mean_v, core->measured_um);
    for (int k = 0; k < HD_MODES; k++) {
        core->measured_um[k] = believed_um(core, k, core->measured_um[k], now_us);
    }
}

static void sense(hd_core_t *core, const hd_phasor_t sensor_um[HD_MODES], uint32_t now_us)
{
    for (int k = 0; k < HD_MODES; k++) {
        core->sensor_um[k] = core->measured_um[k] = believed_um(core, k, sensor_um[k], now_us);
    }
    if (!core->control.design.wires.has_own_sensors) {
        mix(core, now_us);
    }
}

static uint16_t ticks_in(const hd_core_t *core, uint32_t span_us)
{
    return (uint16_t)(core->config.control_hz * 1e-6f * (float)span_us);
}

/* Bounded in rate, so that what follows the output can count on its length and on the gaps. */
static void pulse(hd_core_t *core)
{
    if (core->pulse_ticks == 0 && (core->config.features & HD_FEATURE_SYNC) != 0) {
        core->pulse_ticks = ticks_in(core, HD_PULSE_EVERY_US);
        core->status_flags |= HD_STATUS_PULSED;
    }
}

/* A reference has taken effect at the first tick that is not before its first knot. */
static void acknowledge(hd_core_t *core, uint32_t now_us)
{
    hd_polyline_t *line = hd_timeline_running(&core->timeline);
    if (line == NULL || line->acknowledged || hd_before(now_us, line->t_start_us)) {
        return;
    }
    line->acknowledged = true;
    core->applied = (hd_receipt_t){line->seq, true, line->t_received_us, now_us};
    if (core->newest.seq == line->seq) {
        core->newest = core->applied;
    }
    core->acknowledge = true;
    core->pending |= HD_PENDING_STATUS;
    if (line->pulse) {
        pulse(core);
    }
}

static void follow_timeline(hd_core_t *core, uint32_t now_us)
{
    hd_phasor_t planned_um[HD_MODES];
    hd_timeline_evaluate(&core->timeline, now_us + core->control.design.lookahead_us, planned_um);
    if (core->state == HD_STATE_LIVE) {
        memcpy(core->reference_um, planned_um, sizeof planned_um);
    }
    acknowledge(core, now_us);
}

static float ramp_frac(hd_core_t *core)
{
    if (core->ramp > core->ramp_ticks) { /* a turned bit */
        core->ramp = core->ramp_ticks;
    }
    if (core->state == HD_STATE_LIVE && core->ramp < core->ramp_ticks) {
        core->ramp++;
    } else if (core->state != HD_STATE_LIVE && core->ramp > 0) {
        core->ramp--;
    }
    return core->ramp == core->ramp_ticks ? 1.0f : (float)core->ramp / (float)core->ramp_ticks;
}

/* The ramp bounds voltage and reference: the output reaches zero in time for any sensor value. */
static bool drive(hd_core_t *core, float ramp, uint32_t now_us)
{
    if (ramp == 0.0f) {
        hd_control_reset(&core->control);
        memset(core->asked_um, 0, sizeof core->asked_um);
        memset(core->voltage_v, 0, sizeof core->voltage_v);
        return false;
    }
    for (int k = 0; k < HD_MODES; k++) {
        core->asked_um[k] = hd_scale(ramp, core->reference_um[k]);
    }
    if (ramp == 1.0f && hd_follow_due(&core->follower)) {
        if (now_us - core->t_reached_us >= HD_SATURATED_US) {
            hd_fail(core, HD_FAULT_SATURATED, HD_ALL_MODES, core->config.v_limit_v, now_us);
            return false;
        }
        hd_follow_step(&core->follower, &core->control);
        core->drive_hz = core->follower.drive_hz;
    }
    float v_limit_v = hd_smaller(ramp * core->config.v_limit_v, core->allowed_v);
    return hd_control_step(&core->control, core->asked_um, core->measured_um, v_limit_v, core->voltage_v);
}

/* Open loop, with limits of its own. */
static void use_tool(hd_core_t *core, uint32_t now_us)
{
    if (!hd_tool_step(&core->tool, now_us, core->sensor_um, core->voltage_v)) {
        hd_deadman_reset(&core->deadman);
        hd_enter(core, HD_STATE_QUIET);
    }
    core->drive_hz = hd_tool_drive_hz(&core->tool, core->follower.drive_hz);
    core->pending |= core->tool.count > 0 ? HD_PENDING_SWEEP_POINT : 0;
}

/* High for the first part of the count. */
static bool is_pulse(hd_core_t *core)
{
    if (core->pulse_ticks == 0) {
        return false;
    }
    return core->pulse_ticks-- > ticks_in(core, HD_PULSE_EVERY_US - HD_PULSE_US);
}

static void note_flags(hd_core_t *core, bool saturated)
{
    const hd_polyline_t *line = hd_timeline_running(&core->timeline);
    bool live = core->state == HD_STATE_LIVE;
    bool limited = live && line != NULL && line->limited;
    core->tick_flags = (uint8_t)((saturated ? HD_TICK_SATURATED : 0) | (limited ? HD_TICK_LIMITED : 0)
                                 | (live ? HD_TICK_LIVE : 0) | (core->tripped ? HD_TICK_DEADMAN : 0)
                                 | (is_pulse(core) ? HD_TICK_SYNC : 0));
    core->status_flags |= (uint8_t)((saturated ? HD_STATUS_SATURATED : 0) | (limited ? HD_STATUS_LIMITED : 0));
}

static void sample_telemetry(hd_core_t *core, uint32_t now_us)
{
    if (!hd_telemetry_due(&core->telemetry)) {
        return;
    }
    hd_wire_telemetry_t sample = {
        .t_board_us = now_us,
        .state = core->state,
        .flags = (uint8_t)(((core->tick_flags & HD_TICK_SATURATED) ? HD_STATUS_SATURATED : 0)
                           | ((core->tick_flags & HD_TICK_LIMITED) ? HD_STATUS_LIMITED : 0)),
        .modes = HD_MODES,
    };
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t asked_um = core->asked_um[k], w_um = core->measured_um[k], v_v = core->voltage_v[k];
        hd_estimate_t estimate = hd_control_estimate(&core->control, k);
        sample.mode[k] = (hd_wire_telemetry_mode_t){
            .reference = {asked_um.d, asked_um.q},
            .now = {w_um.d, w_um.q, v_v.d, v_v.q},
            .decay_1_s = hd_sendable(estimate.decay_1_s),
            .detuning_rad_s = hd_sendable(estimate.detuning_rad_s),
        };
    }
    hd_telemetry_push(&core->telemetry, &sample);
    core->pending |= HD_PENDING_TELEMETRY;
}

/* The last gate: nothing but this writes what goes to the amplifiers. */
static void gate(hd_core_t *core, uint32_t now_us, hd_phasor_t voltage_v[HD_MODES])
{
    float limit_v = core->state == HD_STATE_TOOL ? HD_RAW_LIMIT_FRAC * core->config.v_limit_v : core->config.v_limit_v;
    if (hd_limit_voltages(core->voltage_v, limit_v) == HD_LIMIT_NOT_FINITE) {
        hd_fail(core, HD_FAULT_CONTROL_NOT_FINITE, HD_ALL_MODES, 0.0f, now_us);
    }
    memcpy(voltage_v, core->voltage_v, sizeof core->voltage_v);
}

void hd_tick(hd_core_t *core, uint32_t now_us, const hd_phasor_t sensor_um[HD_MODES], hd_phasor_t voltage_v[HD_MODES])
{
    bool saturated = false;
    if (core->control.turn >= HD_MODES) { /* a turned bit: it is an index */
        core->control.turn = 0;
    }
    hd_watch_host(core, now_us);
    sense(core, sensor_um, now_us);
    watch_plate(core, now_us);
    follow_timeline(core, now_us);
    watch_memory(core, now_us);
    if (core->state == HD_STATE_TOOL) {
        use_tool(core, now_us);
    } else {
        saturated = drive(core, ramp_frac(core), now_us);
    }
    if (!saturated) {
        core->t_reached_us = now_us;
    }
    gate(core, now_us, voltage_v);
    core->control.turn = (uint8_t)((core->control.turn + 1u) % HD_MODES);

    note_flags(core, saturated);
    sample_telemetry(core, now_us);
    if (now_us - core->t_status_us >= HD_STATUS_US) {
        core->pending |= HD_PENDING_STATUS;
    }
}
