/* What the core tells the host: frames are made when the line takes them, so what they say is never old. */
#include <string.h>

#include "core.h"

static size_t send_time(hd_core_t *core, uint32_t now_us, uint8_t *out)
{
    hd_wire_time_t time = {
        .t_host_ns = core->time_request_ns,
        .t_received_us = core->t_time_request_us,
        .t_sent_us = now_us,
    };
    return hd_frame_encode(HD_MSG_TIME, &time, sizeof time, out);
}

static size_t send_hello(hd_core_t *core, uint8_t *out)
{
    const hd_config_t *config = &core->config;
    hd_wire_hello_t hello = {
        .protocol_version = HD_PROTOCOL_VERSION,
        .protocol_hash = HD_PROTOCOL_HASH,
        .modes = HD_MODES,
        .firmware_version = HD_FIRMWARE_VERSION,
        .boot_id = config->boot_id,
        .control_hz = config->control_hz,
        .drive_hz = config->drive_hz,
        .deadman_ms = HD_DEADMAN_US / 1000,
        .v_limit_v = config->v_limit_v,
    };
    memcpy(hello.w_limit_um, config->w_limit_um, sizeof hello.w_limit_um);
    return hd_frame_encode(HD_MSG_HELLO, &hello, sizeof hello, out);
}

static size_t send_status(hd_core_t *core, uint32_t now_us, uint8_t *out)
{
    const hd_receipt_t *receipt = core->acknowledge ? &core->applied : &core->newest;
    hd_wire_status_t status = {
        .t_board_us = now_us,
        .state = core->state,
        .flags = (uint8_t)(core->status_flags | (receipt->applied ? HD_STATUS_APPLIED : 0)),
        .fault_code = core->fault,
        .modes = HD_MODES,
        .seq = receipt->seq,
        .t_received_us = receipt->t_received_us,
        .t_applied_us = receipt->t_applied_us,
        .deadman_trips = core->deadman.trips,
        .bad_frames = core->bad_frames,
        .late_frames = core->late_frames,
    };
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t w_um = core->measured_um[k], v_v = core->voltage_v[k];
        status.mode[k] = (hd_wire_mode_t){w_um.d, w_um.q, v_v.d, v_v.q};
    }
    core->status_flags = 0;
    core->acknowledge = false;
    core->t_status_us = now_us;
    return hd_frame_encode(HD_MSG_STATUS, &status, sizeof status, out);
}

static size_t send_verdict(hd_core_t *core, uint8_t *out)
{
    uint8_t request = 0;
    while ((core->verdicts & (1U << request)) == 0) {
        request++;
    }
    core->verdicts &= (uint16_t)~(1U << request);
    hd_wire_verdict_t verdict = {request, core->verdict[request]};
    return hd_frame_encode(HD_MSG_VERDICT, &verdict, sizeof verdict, out);
}

static size_t send_controller(hd_core_t *core, uint8_t *out)
{
    const hd_gains_t *gains = &core->control.gains;
    hd_wire_controller_t controller = {
        .law = gains->law,
        .bandwidth_1_s = gains->bandwidth_1_s,
        .integral_time_s = gains->integral_time_s,
        .modes = HD_MODES,
    };
    for (int k = 0; k < HD_MODES; k++) {
        const hd_mode_model_t *model = &core->control.plant.model[k];
        controller.model[k] = (hd_wire_model_t){
            model->decay_1_s, model->detuning_rad_s, model->gain_um_per_v_s, model->loop.d, model->loop.q,
        };
    }
    return hd_frame_encode(HD_MSG_CONTROLLER, &controller, sizeof controller, out);
}

static size_t send_log(hd_core_t *core, uint8_t *out)
{
    hd_wire_log_t log = {.reset_cause = core->config.reset_cause};
    hd_log_read(&core->config.log, &log);
    return hd_frame_encode(HD_MSG_LOG, &log, sizeof log, out);
}

static size_t send_sweep_point(hd_core_t *core, uint8_t *out)
{
    hd_wire_sweep_point_t point;
    bool taken = hd_tool_pop(&core->tool, &point);
    return taken ? hd_frame_encode(HD_MSG_SWEEP_POINT, &point, sizeof point, out) : 0;
}

static size_t send_telemetry(hd_core_t *core, uint8_t *out)
{
    hd_wire_telemetry_t sample;
    bool taken = hd_telemetry_pop(&core->telemetry, &sample);
    return taken ? hd_frame_encode(HD_MSG_TELEMETRY, &sample, sizeof sample, out) : 0;
}

static size_t send(hd_core_t *core, enum hd_pending kind, uint32_t now_us, uint8_t *out)
{
    switch (kind) {
    case HD_PENDING_TIME:
        return send_time(core, now_us, out);
    case HD_PENDING_HELLO:
        return send_hello(core, out);
    case HD_PENDING_STATUS:
        return send_status(core, now_us, out);
    case HD_PENDING_VERDICT:
        return send_verdict(core, out);
    case HD_PENDING_CONTROLLER:
        return send_controller(core, out);
    case HD_PENDING_LOG:
        return send_log(core, out);
    case HD_PENDING_SWEEP_POINT:
        return send_sweep_point(core, out);
    case HD_PENDING_TELEMETRY:
        return send_telemetry(core, out);
    }
    return 0;
}

/* Several of these may wait: their bit stays until the last is sent. */
static bool more_of(const hd_core_t *core, enum hd_pending kind)
{
    return (kind == HD_PENDING_VERDICT && core->verdicts != 0)
        || (kind == HD_PENDING_SWEEP_POINT && core->tool.count > 0)
        || (kind == HD_PENDING_TELEMETRY && core->telemetry.count > 0);
}

size_t hd_transmit(hd_core_t *core, uint32_t now_us, uint8_t *out, size_t capacity)
{
    size_t n = 0;
    while (core->pending != 0 && capacity - n >= HD_TRANSMIT_MIN) {
        enum hd_pending kind = (enum hd_pending)(core->pending & -core->pending); /* the lowest bit: the most urgent */
        n += send(core, kind, now_us, out + n);
        if (!more_of(core, kind)) {
            core->pending &= (uint16_t)~kind;
        }
    }
    return n;
}
