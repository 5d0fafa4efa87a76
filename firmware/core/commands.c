/* What a person's commands do to the core, and its replies to them: each command is checked as a whole before anything is
 * changed, and answered. At the end the tables of all messages: a new one has its row there, and its functions here. */
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
static void prepare_set_controller(hd_core_t *core, const uint8_t *payload)
{
    hd_staged_t *staged = &core->staged;
    hd_wire_set_controller_t wire;
    memcpy(&wire, payload, sizeof wire);
    staged->design = core->control.design;
    hd_gains_t gains = {wire.law, wire.bandwidth_1_s, wire.integral_time_s};
    staged->design.gains = hd_gains_complete(gains, staged->design.plant.tick_s);
    staged->in_range = hd_gains_valid(&staged->design.gains);
    if (staged->in_range) {
        hd_control_design(&staged->design);
        staged->in_range = hd_control_stable(&staged->design);
    }
}

static void take_set_controller(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    if (!core->staged.in_range) {
        answer(core, HD_MSG_SET_CONTROLLER, HD_VERDICT_OUT_OF_RANGE);
    } else if (core->state == HD_STATE_TOOL) {
        answer(core, HD_MSG_SET_CONTROLLER, HD_VERDICT_NOT_QUIET);
    } else {
        hd_control_adopt(&core->control, &core->staged.design); /* one law's integral is another law's error */
        hd_memory_restart(core);
        core->ramp = 0;
        answer(core, HD_MSG_SET_CONTROLLER, HD_VERDICT_DONE);
    }
}

static void prepare_set_model(hd_core_t *core, const uint8_t *payload)
{
    hd_staged_t *staged = &core->staged;
    hd_wire_set_model_t wire;
    memcpy(&wire, payload, sizeof wire);
    hd_mode_model_t model = {
        .decay_1_s = wire.model.decay_1_s,
        .detuning_rad_s = wire.model.detuning_rad_s,
        .gain_um_per_v_s = wire.model.gain_um_per_v_s,
        .loop = {wire.model.loop_d, wire.model.loop_q},
    };
    staged->in_range = wire.mode < HD_MODES && hd_model_valid(&model);
    if (staged->in_range) {
        model.loop = hd_scale(1.0f / hd_magnitude(model.loop), model.loop);
        staged->design = core->control.design;
        staged->design.plant.model[wire.mode] = model;
        hd_control_design(&staged->design);
    }
}

static void wired_phasors(hd_phasor_t to[HD_MODES][HD_MODES], const hd_wire_phasor_t *from)
{
    for (int i = 0; i < HD_MODES * HD_MODES; i++) {
        to[i / HD_MODES][i % HD_MODES] = (hd_phasor_t){from[i].d_um, from[i].q_um};
    }
}

static void prepare_set_wiring(hd_core_t *core, const uint8_t *payload)
{
    hd_staged_t *staged = &core->staged;
    hd_wire_set_wiring_t wire;
    memcpy(&wire, payload, sizeof wire);
    staged->design = core->control.design;
    hd_wiring_t *wiring = &staged->design.plant.wiring;
    memcpy(wiring->drive, wire.drive, sizeof wiring->drive);
    wired_phasors(wiring->sense, wire.sense);
    wired_phasors(wiring->feedthrough_um_per_v, wire.feedthrough);
    staged->in_range = hd_wiring_valid(wiring);
    if (staged->in_range) {
        hd_control_design(&staged->design);
    }
}

/* Another plant, for a plate at rest; true if it is in force. */
static bool take_plant(hd_core_t *core, enum hd_message request)
{
    bool quiet = hd_at_rest(core) && core->fault != HD_FAULT_CONFIG;
    bool taken = core->staged.in_range && quiet;
    if (taken) {
        hd_control_adopt(&core->control, &core->staged.design);
        hd_memory_restart(core);
    }
    answer(core, request, taken ? HD_VERDICT_DONE : core->staged.in_range ? HD_VERDICT_NOT_QUIET : HD_VERDICT_OUT_OF_RANGE);
    return taken;
}

static void take_set_model(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    take_plant(core, HD_MSG_SET_MODEL);
}

static void take_set_wiring(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    take_plant(core, HD_MSG_SET_WIRING);
}

/* The modes stay where they are, and so are detuned by as much less. */
static void prepare_set_drive(hd_core_t *core, const uint8_t *payload)
{
    hd_staged_t *staged = &core->staged;
    hd_wire_set_drive_t wire;
    memcpy(&wire, payload, sizeof wire);
    staged->in_range = fabsf(wire.drive_hz - core->config.drive_hz) <= HD_DRIVE_MOVE_MAX_HZ && wire.drive_hz >= 1.0f
        && wire.follow_hz >= 0.0f && wire.follow_hz <= HD_FOLLOW_MAX_HZ;
    staged->design = core->control.design;
    for (int k = 0; staged->in_range && k < HD_MODES; k++) {
        hd_mode_model_t *model = &staged->design.plant.model[k];
        model->detuning_rad_s -= HD_TURN_RAD * (wire.drive_hz - core->follower.base_hz);
        staged->in_range = hd_model_valid(model);
    }
    if (staged->in_range) {
        hd_control_design(&staged->design);
    }
}

static void take_set_drive(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)now_us;
    hd_wire_set_drive_t wire;
    memcpy(&wire, payload, sizeof wire);
    if (take_plant(core, HD_MSG_SET_DRIVE)) {
        hd_follow_set(&core->follower, wire.drive_hz, wire.follow_hz);
        core->drive_hz = wire.drive_hz;
    }
}

static void take_set_baud(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
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

static void take_sweep(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
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

static void take_raw_voltage(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
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

static void take_set_telemetry(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)now_us;
    hd_wire_set_telemetry_t wire;
    memcpy(&wire, payload, sizeof wire);
    hd_telemetry_start(&core->telemetry, wire.rate_hz, core->config.control_hz);
    answer(core, HD_MSG_SET_TELEMETRY, HD_VERDICT_DONE);
}

static void take_stop(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    if (core->state == HD_STATE_TOOL) {
        hd_tool_stop(&core->tool);
    }
    answer(core, HD_MSG_STOP, HD_VERDICT_DONE);
}

static void take_controller_request(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    core->pending |= HD_PENDING_CONTROLLER;
}

static void take_log_request(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    core->pending |= HD_PENDING_LOG;
}

static bool fill_verdict(hd_core_t *core, uint32_t now_us, hd_message_t *message)
{
    (void)now_us;
    uint8_t request = 0;
    while ((core->verdicts & (1U << request)) == 0) {
        request++;
    }
    core->verdicts &= ~(1U << request);
    message->payload.verdict = (hd_wire_verdict_t){request, core->verdict[request]};
    return true;
}

static bool fill_controller(hd_core_t *core, uint32_t now_us, hd_message_t *message)
{
    (void)now_us;
    hd_wire_controller_t *controller = &message->payload.controller;
    const hd_gains_t *gains = &core->control.design.gains;
    *controller = (hd_wire_controller_t){
        .law = gains->law,
        .bandwidth_1_s = gains->bandwidth_1_s,
        .integral_time_s = gains->integral_time_s,
        .modes = HD_MODES,
    };
    for (int k = 0; k < HD_MODES; k++) {
        const hd_mode_model_t *model = &core->control.design.plant.model[k];
        controller->model[k] = (hd_wire_model_t){
            model->decay_1_s, model->detuning_rad_s, model->gain_um_per_v_s, model->loop.d, model->loop.q,
        };
    }
    return true;
}

static bool fill_log(hd_core_t *core, uint32_t now_us, hd_message_t *message)
{
    (void)now_us;
    message->payload.log = (hd_wire_log_t){.reset_cause = core->config.reset_cause};
    hd_log_read(&core->config.log, &message->payload.log);
    return true;
}

static bool fill_sweep_point(hd_core_t *core, uint32_t now_us, hd_message_t *message)
{
    (void)now_us;
    return hd_tool_pop(&core->tool, &message->payload.sweep_point);
}

static bool fill_telemetry(hd_core_t *core, uint32_t now_us, hd_message_t *message)
{
    (void)now_us;
    return hd_telemetry_pop(&core->telemetry, &message->payload.telemetry);
}

/* Everything but REFERENCE, whose length varies. */
static const hd_command_t COMMANDS[] = {
    {HD_MSG_HELLO_REQUEST, 0, hd_take_hello_request, NULL},
    {HD_MSG_KEEPALIVE, sizeof(hd_wire_keepalive_t), hd_take_keepalive, NULL},
    {HD_MSG_TIME_REQUEST, sizeof(hd_wire_time_request_t), hd_take_time_request, NULL},
    {HD_MSG_CLEAR_FAULT, 0, hd_take_clear_fault, NULL},
    {HD_MSG_SET_CONTROLLER, sizeof(hd_wire_set_controller_t), take_set_controller, prepare_set_controller},
    {HD_MSG_SET_MODEL, sizeof(hd_wire_set_model_t), take_set_model, prepare_set_model},
    {HD_MSG_CONTROLLER_REQUEST, 0, take_controller_request, NULL},
    {HD_MSG_SWEEP, sizeof(hd_wire_sweep_t), take_sweep, NULL},
    {HD_MSG_RAW_VOLTAGE, sizeof(hd_wire_raw_voltage_t), take_raw_voltage, NULL},
    {HD_MSG_SET_TELEMETRY, sizeof(hd_wire_set_telemetry_t), take_set_telemetry, NULL},
    {HD_MSG_LOG_REQUEST, 0, take_log_request, NULL},
    {HD_MSG_STOP, 0, take_stop, NULL},
    {HD_MSG_SET_WIRING, sizeof(hd_wire_set_wiring_t), take_set_wiring, prepare_set_wiring},
    {HD_MSG_SET_DRIVE, sizeof(hd_wire_set_drive_t), take_set_drive, prepare_set_drive},
    {HD_MSG_SET_BAUD, sizeof(hd_wire_set_baud_t), take_set_baud, NULL},
};

/* By the bits of hd_pending. */
static const hd_reply_t REPLIES[] = {
    {HD_MSG_TIME, sizeof(hd_wire_time_t), hd_fill_time},
    {HD_MSG_HELLO, sizeof(hd_wire_hello_t), hd_fill_hello},
    {HD_MSG_STATUS, sizeof(hd_wire_status_t), hd_fill_status},
    {HD_MSG_VERDICT, sizeof(hd_wire_verdict_t), fill_verdict},
    {HD_MSG_CONTROLLER, sizeof(hd_wire_controller_t), fill_controller},
    {HD_MSG_LOG, sizeof(hd_wire_log_t), fill_log},
    {HD_MSG_SWEEP_POINT, sizeof(hd_wire_sweep_point_t), fill_sweep_point},
    {HD_MSG_TELEMETRY, sizeof(hd_wire_telemetry_t), fill_telemetry},
};

const hd_command_t *hd_command(uint8_t type, size_t size)
{
    for (size_t i = 0; i < sizeof COMMANDS / sizeof COMMANDS[0]; i++) {
        if (COMMANDS[i].type == type) {
            return COMMANDS[i].size == size ? &COMMANDS[i] : NULL;
        }
    }
    return NULL;
}

uint32_t hd_commands(void)
{
    uint32_t types = 1U << HD_MSG_REFERENCE;
    for (size_t i = 0; i < sizeof COMMANDS / sizeof COMMANDS[0]; i++) {
        types |= 1U << COMMANDS[i].type;
    }
    return types;
}

const hd_reply_t *hd_reply(enum hd_pending kind)
{
    const hd_reply_t *reply = REPLIES;
    for (unsigned bits = kind; bits > 1; bits >>= 1) {
        reply++;
    }
    return reply;
}
