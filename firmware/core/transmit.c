/* Messages to the host, made when the line can send them, so that they are current. */
#include <string.h>

#include "core.h"

static void fill_time(hd_core_t *core, uint32_t now_us, hd_wire_time_t *time)
{
    *time = (hd_wire_time_t){
        .t_host_ns = core->time_request_ns,
        .t_received_us = core->t_time_request_us,
        .t_sent_us = now_us,
    };
}

static void fill_hello(hd_core_t *core, hd_wire_hello_t *hello)
{
    const hd_config_t *config = &core->config;
    *hello = (hd_wire_hello_t){
        .protocol_version = HD_PROTOCOL_VERSION,
        .protocol_hash = HD_PROTOCOL_HASH,
        .modes = HD_MODES,
        .firmware_version = HD_FIRMWARE_VERSION,
        .boot_id = config->boot_id,
        .control_hz = config->control_hz,
        .drive_hz = core->follower.base_hz,
        .deadman_ms = HD_DEADMAN_US / 1000,
        .v_limit_v = config->v_limit_v,
        .image_crc = config->image_crc,
        .baud_max = config->baud_max,
        .features = config->features,
        .commands = hd_commands(),
    };
    memcpy(hello->w_limit_um, config->w_limit_um, sizeof hello->w_limit_um);
}

static void fill_status(hd_core_t *core, uint32_t now_us, hd_wire_status_t *status)
{
    const hd_receipt_t *receipt = core->acknowledge ? &core->applied : &core->newest;
    *status = (hd_wire_status_t){
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
        .drive_hz = core->drive_hz,
        .number = core->statuses++,
        .refused_seq = core->refused_seq,
        .refusal = core->refusal,
    };
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t w_um = core->measured_um[k], v_v = core->voltage_v[k];
        status->mode[k] = (hd_wire_mode_t){w_um.d, w_um.q, v_v.d, v_v.q};
    }
    core->status_flags = 0;
    core->acknowledge = false;
    core->t_status_us = now_us;
}

static void fill_verdict(hd_core_t *core, hd_wire_verdict_t *verdict)
{
    uint8_t request = 0;
    while ((core->verdicts & (1U << request)) == 0) {
        request++;
    }
    core->verdicts &= ~(1U << request);
    *verdict = (hd_wire_verdict_t){request, core->verdict[request]};
}

static void fill_controller(hd_core_t *core, hd_wire_controller_t *controller)
{
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
}

static void fill_log(hd_core_t *core, hd_wire_log_t *log)
{
    *log = (hd_wire_log_t){.reset_cause = core->config.reset_cause};
    hd_log_read(&core->config.log, log);
}

#define FILLED(message, which, id) ((message)->n = sizeof (message)->payload.which, (message)->type = (id), true)

/* False if the stream has no more samples. */
static bool fill(hd_core_t *core, enum hd_pending kind, uint32_t now_us, hd_message_t *message)
{
    switch (kind) {
    case HD_PENDING_TIME:
        fill_time(core, now_us, &message->payload.time);
        return FILLED(message, time, HD_MSG_TIME);
    case HD_PENDING_HELLO:
        fill_hello(core, &message->payload.hello);
        return FILLED(message, hello, HD_MSG_HELLO);
    case HD_PENDING_STATUS:
        fill_status(core, now_us, &message->payload.status);
        return FILLED(message, status, HD_MSG_STATUS);
    case HD_PENDING_VERDICT:
        fill_verdict(core, &message->payload.verdict);
        return FILLED(message, verdict, HD_MSG_VERDICT);
    case HD_PENDING_CONTROLLER:
        fill_controller(core, &message->payload.controller);
        return FILLED(message, controller, HD_MSG_CONTROLLER);
    case HD_PENDING_LOG:
        fill_log(core, &message->payload.log);
        return FILLED(message, log, HD_MSG_LOG);
    case HD_PENDING_SWEEP_POINT:
        return hd_tool_pop(&core->tool, &message->payload.sweep_point)
            && FILLED(message, sweep_point, HD_MSG_SWEEP_POINT);
    case HD_PENDING_TELEMETRY:
        return hd_telemetry_pop(&core->telemetry, &message->payload.telemetry)
            && FILLED(message, telemetry, HD_MSG_TELEMETRY);
    }
    return false;
}

/* Several of these may wait: their bit stays until the last is sent. */
static bool more_of(const hd_core_t *core, enum hd_pending kind)
{
    return (kind == HD_PENDING_VERDICT && core->verdicts != 0)
        || (kind == HD_PENDING_SWEEP_POINT && core->tool.count > 0)
        || (kind == HD_PENDING_TELEMETRY && core->telemetry.count > 0);
}

bool hd_say(hd_core_t *core, uint32_t now_us, hd_message_t *message)
{
    bool has_message = false;
    while (!has_message && core->pending != 0) {
        enum hd_pending kind = (enum hd_pending)(core->pending & -core->pending); /* the lowest bit: the most urgent */
        has_message = fill(core, kind, now_us, message);
        if (!more_of(core, kind)) {
            core->pending &= (uint16_t)~kind;
        }
    }
    return has_message;
}

size_t hd_message_encode(const hd_message_t *message, uint8_t *out)
{
    return hd_frame_encode(message->type, &message->payload, message->n, out);
}

size_t hd_transmit(hd_core_t *core, uint32_t now_us, uint8_t *out, size_t capacity)
{
    size_t n = 0;
    hd_message_t message;
    while (capacity - n >= HD_TRANSMIT_MIN && hd_say(core, now_us, &message)) {
        n += hd_message_encode(&message, out + n);
    }
    return n;
}
