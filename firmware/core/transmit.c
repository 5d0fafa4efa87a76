/* Messages to the host, made when the line can send them, so that they are current. */
#include <string.h>

#include "commands.h"
#include "core.h"

bool hd_fill_time(hd_core_t *core, uint32_t now_us, hd_message_t *message)
{
    message->payload.time = (hd_wire_time_t){
        .t_host_ns = core->time_request_ns,
        .t_received_us = core->t_time_request_us,
        .t_sent_us = now_us,
    };
    return true;
}

bool hd_fill_hello(hd_core_t *core, uint32_t now_us, hd_message_t *message)
{
    (void)now_us;
    hd_wire_hello_t *hello = &message->payload.hello;
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
    return true;
}

bool hd_fill_status(hd_core_t *core, uint32_t now_us, hd_message_t *message)
{
    hd_wire_status_t *status = &message->payload.status;
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
    uint8_t holdable[sizeof status->holdable] = {0};
    for (int k = 0; k < HD_MODES; k++) {
        hd_phasor_t w_um = core->measured_um[k], v_v = core->voltage_v[k];
        status->mode[k] = (hd_wire_mode_t){w_um.d, w_um.q, v_v.d, v_v.q};
        float share = hd_control_holdable(&core->control, k, core->config.w_limit_um[k], core->config.v_limit_v);
        holdable[k] = (uint8_t)(1.0f + 254.0f * share);
    }
    memcpy(&status->holdable, holdable, sizeof holdable);
    core->status_flags = 0;
    core->acknowledge = false;
    core->t_status_us = now_us;
    return true;
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
        const hd_reply_t *reply = hd_reply(kind);
        message->type = reply->type;
        message->n = reply->size;
        has_message = reply->fill(core, now_us, message);
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
