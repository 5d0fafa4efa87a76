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

size_t hd_transmit(hd_core_t *core, uint32_t now_us, uint8_t *out, size_t capacity)
{
    size_t n = 0;
    while (core->pending != 0 && capacity - n >= HD_TRANSMIT_MIN) {
        if (core->pending & HD_PENDING_TIME) {
            core->pending &= (uint8_t)~HD_PENDING_TIME;
            n += send_time(core, now_us, out + n);
        } else if (core->pending & HD_PENDING_HELLO) {
            core->pending &= (uint8_t)~HD_PENDING_HELLO;
            n += send_hello(core, out + n);
        } else {
            core->pending &= (uint8_t)~HD_PENDING_STATUS;
            n += send_status(core, now_us, out + n);
        }
    }
    return n;
}
