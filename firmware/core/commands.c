/* What a person's commands do to the core. Each is checked as a whole before anything is changed, and answered. */
#include "commands.h"

#include <string.h>

/* Answers a well-formed command. Of several answers to one kind of command the first
 * refusal is the one that is sent: a later success must not hide it. */
static void answer(hd_core_t *core, enum hd_message request, enum hd_verdict verdict)
{
    uint32_t bit = 1U << request;
    bool refused = (core->verdicts & bit) != 0 && core->verdict[request] != HD_VERDICT_DONE;
    if (!refused) {
        core->verdict[request] = (uint8_t)verdict;
    }
    core->verdicts |= bit;
    core->pending |= HD_PENDING_VERDICT;
}

/* Only the main loop changes the design that is in force, so it may be read here while a tick interrupts. */
void hd_prepare_set_controller(hd_core_t *core, const uint8_t *payload)
{
    hd_heard_t *heard = &core->heard;
    hd_wire_set_controller_t wire;
    memcpy(&wire, payload, sizeof wire);
    heard->design = core->control.design;
    hd_gains_t gains = {wire.law, wire.bandwidth_1_s, wire.integral_time_s};
    heard->design.gains = hd_gains_complete(gains, heard->design.plant.tick_s);
    heard->in_range = hd_gains_valid(&heard->design.gains);
    if (heard->in_range) {
        hd_control_design(&heard->design);
        heard->in_range = hd_control_stable(&heard->design);
    }
}

void hd_take_set_controller(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    if (!core->heard.in_range) {
        answer(core, HD_MSG_SET_CONTROLLER, HD_VERDICT_OUT_OF_RANGE);
    } else if (core->state == HD_STATE_TOOL) {
        answer(core, HD_MSG_SET_CONTROLLER, HD_VERDICT_NOT_QUIET);
    } else {
        hd_control_adopt(&core->control, &core->heard.design); /* one law's integral is another law's error */
        core->ramp = 0;
        answer(core, HD_MSG_SET_CONTROLLER, HD_VERDICT_DONE);
    }
}

void hd_prepare_set_model(hd_core_t *core, const uint8_t *payload)
{
    hd_heard_t *heard = &core->heard;
    hd_wire_set_model_t wire;
    memcpy(&wire, payload, sizeof wire);
    hd_mode_model_t model = {
        .decay_1_s = wire.model.decay_1_s,
        .detuning_rad_s = wire.model.detuning_rad_s,
        .gain_um_per_v_s = wire.model.gain_um_per_v_s,
        .loop = {wire.model.loop_d, wire.model.loop_q},
    };
    heard->in_range = wire.mode < HD_MODES && hd_model_valid(&model);
    if (heard->in_range) {
        model.loop = hd_scale(1.0f / hd_magnitude(model.loop), model.loop);
        heard->design = core->control.design;
        heard->design.plant.model[wire.mode] = model;
        hd_control_design(&heard->design);
    }
}

static void wired_phasors(hd_phasor_t to[HD_MODES][HD_MODES], const hd_wire_phasor_t *from)
{
    for (int i = 0; i < HD_MODES * HD_MODES; i++) {
        to[i / HD_MODES][i % HD_MODES] = (hd_phasor_t){from[i].d_um, from[i].q_um};
    }
}

void hd_prepare_set_wiring(hd_core_t *core, const uint8_t *payload)
{
    hd_heard_t *heard = &core->heard;
    hd_wire_set_wiring_t wire;
    memcpy(&wire, payload, sizeof wire);
    heard->design = core->control.design;
    hd_wiring_t *wiring = &heard->design.plant.wiring;
    memcpy(wiring->drive, wire.drive, sizeof wiring->drive);
    wired_phasors(wiring->sense, wire.sense);
    wired_phasors(wiring->feedthrough_um_per_v, wire.feedthrough);
    heard->in_range = hd_wiring_valid(wiring);
    if (heard->in_range) {
        hd_control_design(&heard->design);
    }
}

/* Another plant, for a plate at rest; true if it is in force. */
static bool take_plant(hd_core_t *core, enum hd_message request)
{
    bool quiet = hd_at_rest(core) && core->fault != HD_FAULT_CONFIG;
    bool taken = core->heard.in_range && quiet;
    if (taken) {
        hd_control_adopt(&core->control, &core->heard.design);
    }
    answer(core, request, taken ? HD_VERDICT_DONE : core->heard.in_range ? HD_VERDICT_NOT_QUIET : HD_VERDICT_OUT_OF_RANGE);
    return taken;
}

void hd_take_set_model(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    take_plant(core, HD_MSG_SET_MODEL);
}

void hd_take_set_wiring(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    take_plant(core, HD_MSG_SET_WIRING);
}

/* The modes stay where they are, and so are detuned by as much less. */
void hd_prepare_set_drive(hd_core_t *core, const uint8_t *payload)
{
    hd_heard_t *heard = &core->heard;
    hd_wire_set_drive_t wire;
    memcpy(&wire, payload, sizeof wire);
    heard->in_range = fabsf(wire.drive_hz - core->config.drive_hz) <= HD_DRIVE_MOVE_MAX_HZ && wire.drive_hz >= 1.0f
        && wire.follow_hz >= 0.0f && wire.follow_hz <= HD_FOLLOW_MAX_HZ;
    heard->design = core->control.design;
    for (int k = 0; heard->in_range && k < HD_MODES; k++) {
        hd_mode_model_t *model = &heard->design.plant.model[k];
        model->detuning_rad_s -= HD_TURN_RAD * (wire.drive_hz - core->follower.base_hz);
        heard->in_range = hd_model_valid(model);
    }
    if (heard->in_range) {
        hd_control_design(&heard->design);
    }
}

void hd_take_set_drive(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)now_us;
    hd_wire_set_drive_t wire;
    memcpy(&wire, payload, sizeof wire);
    if (take_plant(core, HD_MSG_SET_DRIVE)) {
        hd_follow_set(&core->follower, wire.drive_hz, wire.follow_hz);
        core->drive_hz = wire.drive_hz;
    }
}

void hd_take_set_baud(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)now_us;
    hd_wire_set_baud_t wire;
    memcpy(&wire, payload, sizeof wire);
    if (wire.baud < HD_BAUD_MIN || wire.baud > core->config.baud_max) {
        answer(core, HD_MSG_SET_BAUD, HD_VERDICT_OUT_OF_RANGE);
    } else if (!hd_at_rest(core)) {
        answer(core, HD_MSG_SET_BAUD, HD_VERDICT_NOT_QUIET);
    } else {
        core->baud = wire.baud;
        answer(core, HD_MSG_SET_BAUD, HD_VERDICT_DONE);
    }
}

void hd_take_sweep(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    hd_wire_sweep_t sweep;
    memcpy(&sweep, payload, sizeof sweep);
    if (!hd_sweep_valid(&core->tool, &sweep)) {
        answer(core, HD_MSG_SWEEP, HD_VERDICT_OUT_OF_RANGE);
    } else if (!hd_at_rest(core) || core->state == HD_STATE_FAULT) {
        answer(core, HD_MSG_SWEEP, HD_VERDICT_NOT_QUIET);
    } else {
        hd_silence(core);
        hd_tool_sweep(&core->tool, &sweep);
        hd_begin_tool(core, now_us);
        answer(core, HD_MSG_SWEEP, HD_VERDICT_DONE);
    }
}

void hd_take_raw_voltage(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    hd_wire_raw_voltage_t raw;
    memcpy(&raw, payload, sizeof raw);
    const hd_tool_t *tool = &core->tool;
    bool renewed = tool->kind == HD_TOOL_RAW && !tool->stopping && raw.mode == tool->mode;
    if (!hd_raw_voltage_valid(tool, &raw)) {
        answer(core, HD_MSG_RAW_VOLTAGE, HD_VERDICT_OUT_OF_RANGE);
    } else if (!renewed && (!hd_at_rest(core) || core->state == HD_STATE_FAULT)) {
        answer(core, HD_MSG_RAW_VOLTAGE, HD_VERDICT_NOT_QUIET);
    } else {
        if (!renewed) {
            hd_silence(core);
        }
        hd_tool_raw_voltage(&core->tool, &raw, now_us);
        hd_begin_tool(core, now_us);
        answer(core, HD_MSG_RAW_VOLTAGE, HD_VERDICT_DONE);
    }
}

void hd_take_set_telemetry(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)now_us;
    hd_wire_set_telemetry_t wire;
    memcpy(&wire, payload, sizeof wire);
    hd_telemetry_start(&core->telemetry, wire.rate_hz, core->config.control_hz);
    answer(core, HD_MSG_SET_TELEMETRY, HD_VERDICT_DONE);
}

void hd_take_stop(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    if (core->state == HD_STATE_TOOL) {
        hd_tool_stop(&core->tool);
    }
    answer(core, HD_MSG_STOP, HD_VERDICT_DONE);
}

void hd_take_controller_request(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    core->pending |= HD_PENDING_CONTROLLER;
}

void hd_take_log_request(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    core->pending |= HD_PENDING_LOG;
}
