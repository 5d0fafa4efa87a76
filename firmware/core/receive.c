/* The host's frames, and the messages of its session. Each is validated completely before it changes anything. */
#include <string.h>

#include "commands.h"
#include "core.h"
#include "limiter.h"

static void refuse(hd_core_t *core)
{
    core->bad_frames++;
    hd_deadman_bad_frame(&core->deadman);
}

static void note_refusal(hd_core_t *core, uint16_t seq, enum hd_refusal why)
{
    core->refused_seq = seq;
    core->refusal = (uint8_t)why;
}

static hd_wire_knot_t wire_knot(const uint8_t *knots, int i)
{
    hd_wire_knot_t knot;
    memcpy(&knot, knots + (size_t)i * sizeof knot, sizeof knot);
    return knot;
}

static bool knot_finite(const hd_wire_knot_t *knot)
{
    for (int k = 0; k < HD_MODES; k++) {
        if (!hd_finite((hd_phasor_t){knot->modal[k].d_um, knot->modal[k].q_um})) {
            return false;
        }
    }
    return true;
}

static bool knots_valid(const uint8_t *knots, int n)
{
    int previous = -1;
    for (int i = 0; i < n; i++) {
        hd_wire_knot_t knot = wire_knot(knots, i);
        if (knot.offset <= previous || !knot_finite(&knot)) {
            return false;
        }
        previous = knot.offset;
    }
    return true;
}

static uint8_t knots_of(const hd_wire_reference_t *head)
{
    return head->knots & (uint8_t)~HD_REFERENCE_PULSE;
}

static bool reference_valid(const hd_wire_reference_t *head, const uint8_t *knots, size_t knots_size)
{
    uint8_t n = knots_of(head);
    return head->modes == HD_MODES && n >= 1 && n <= HD_KNOTS_MAX && knots_size == n * sizeof(hd_wire_knot_t)
        && knots_valid(knots, n);
}

/* Converts knots for the timeline: in us after the first, and within the limits. */
static void read_polyline(hd_core_t *core, const hd_wire_reference_t *head, const uint8_t *knots)
{
    uint32_t lead_us = (uint32_t)wire_knot(knots, 0).offset * HD_KNOT_UNIT_US;
    hd_polyline_t *line = &core->staged.line;
    *line = (hd_polyline_t){.t_start_us = head->t_apply_us + lead_us, .seq = head->seq, .n = knots_of(head),
                            .pulse = head->knots != knots_of(head)};
    for (int i = 0; i < line->n; i++) {
        hd_wire_knot_t knot = wire_knot(knots, i);
        line->knot[i].offset_us = (uint32_t)knot.offset * HD_KNOT_UNIT_US - lead_us;
        for (int k = 0; k < HD_MODES; k++) {
            line->knot[i].modal_um[k] = (hd_phasor_t){knot.modal[k].d_um, knot.modal[k].q_um};
        }
        hd_limit_t limit = hd_limit_amplitudes(line->knot[i].modal_um, core->config.w_limit_um);
        line->limited = line->limited || limit != HD_LIMIT_UNTOUCHED;
    }
}

static bool read_reference(hd_core_t *core, const uint8_t *payload, size_t n)
{
    hd_wire_reference_t head;
    if (n < sizeof head) {
        return false;
    }
    memcpy(&head, payload, sizeof head);
    const uint8_t *knots = payload + sizeof head;
    if (!reference_valid(&head, knots, n - sizeof head)) {
        return false;
    }
    core->staged.t_apply_us = head.t_apply_us;
    read_polyline(core, &head, knots);
    return true;
}

static void store_polyline(hd_core_t *core, uint32_t now_us)
{
    hd_polyline_t *slot = hd_timeline_open(&core->timeline, core->staged.line.t_start_us);
    core->staged.line.t_received_us = now_us;
    core->staged.line.pulse = core->staged.line.pulse || slot->pulse; /* a marked one is replaced, its mark is not lost */
    *slot = core->staged.line;
    if (hd_before(core->staged.line.t_start_us, now_us)) {
        core->late_frames++;
    }
}

static void take_reference(hd_core_t *core, uint32_t now_us)
{
    uint16_t seq = core->staged.line.seq;
    int32_t ahead_us = (int32_t)(core->staged.t_apply_us - now_us);
    if (ahead_us > HD_AHEAD_US) {
        note_refusal(core, seq, HD_REFUSAL_AHEAD);
        refuse(core);
    } else if (core->state == HD_STATE_TOOL) {
        note_refusal(core, seq, HD_REFUSAL_TOOL);
        core->late_frames++; /* a tool drives the plate: no reference may be pending when it ends */
    } else if (core->has_seq && (int16_t)(uint16_t)(seq - core->newest.seq) <= 0) {
        note_refusal(core, seq, HD_REFUSAL_ORDER);
        core->late_frames++; /* a duplicate or an older one: no effect, and no sign of life */
    } else if (ahead_us < -HD_STALE_US) {
        note_refusal(core, seq, HD_REFUSAL_STALE);
        core->late_frames++;
        hd_deadman_bad_frame(&core->deadman);
    } else {
        store_polyline(core, now_us);
        core->has_seq = true;
        core->newest = (hd_receipt_t){.seq = seq, .t_received_us = now_us};
        hd_deadman_good_reference(&core->deadman, now_us);
        core->control.turn = (uint8_t)(seq % HD_MODES); /* or a mode's would fall on the same ticks of all references */
    }
}

/* Whether a reference that moves the plate is so old that its planner must have stopped. */
static bool outlived(const hd_core_t *core, uint32_t now_us)
{
    float moves_um = 0.0f;
    for (int k = 0; k < HD_MODES; k++) {
        moves_um += hd_magnitude(core->reference_um[k]);
    }
    return moves_um > 0.0f && now_us - core->newest.t_received_us > HD_REFERENCE_AGE_US;
}

void hd_take_keepalive(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    hd_wire_keepalive_t keepalive;
    memcpy(&keepalive, payload, sizeof keepalive);
    bool any_will_do = core->state == HD_STATE_TOOL; /* during a tool there are no references */
    if (any_will_do || (core->has_seq && keepalive.seq == core->newest.seq && !outlived(core, now_us))) {
        hd_deadman_good_keepalive(&core->deadman, now_us);
    } else {
        core->late_frames++; /* of a reference that never arrived or is too old: report it */
    }
}

void hd_take_hello_request(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    hd_silence(core);
    hd_deadman_reset(&core->deadman);
    hd_telemetry_start(&core->telemetry, 0, core->config.control_hz);
    core->has_seq = false;
    core->tripped = false;
    core->acknowledge = false;
    core->newest = core->applied = (hd_receipt_t){0};
    note_refusal(core, 0, HD_REFUSAL_NONE);
    core->state = core->state == HD_STATE_FAULT ? HD_STATE_FAULT : HD_STATE_QUIET;
    core->tool.count = 0;
    core->verdicts = 0;
    core->pending &= HD_PENDING_TIME | HD_PENDING_STATUS; /* the rest belonged to the previous session */
    core->pending |= HD_PENDING_HELLO;
}

void hd_take_clear_fault(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    (void)payload;
    (void)now_us;
    if (core->state == HD_STATE_FAULT && core->fault != HD_FAULT_CONFIG && core->fault != HD_FAULT_MEMORY) {
        core->state = HD_STATE_QUIET;
        core->fault = HD_FAULT_NONE;
        core->tripped = false;
        hd_silence(core);
        hd_deadman_reset(&core->deadman);
    }
    core->pending |= HD_PENDING_STATUS;
}

void hd_take_time_request(hd_core_t *core, const uint8_t *payload, uint32_t now_us)
{
    hd_wire_time_request_t request;
    memcpy(&request, payload, sizeof request);
    core->time_request_ns = request.t_host_ns;
    core->t_time_request_us = now_us;
    core->pending |= HD_PENDING_TIME;
}

static bool prepare(hd_core_t *core, const hd_command_t *command, const uint8_t *payload)
{
    if (command != NULL && command->prepare != NULL) {
        command->prepare(core, payload);
    }
    return command != NULL;
}

bool hd_hear(hd_core_t *core, uint8_t byte)
{
    hd_staged_t *staged = &core->staged;
    const uint8_t *frame = core->receiver.bytes;
    hd_rx_t event = hd_receiver_push(&core->receiver, byte, &staged->frame_n);
    if (event == HD_RX_PENDING) {
        return false;
    }
    staged->whole = event == HD_RX_FRAME;
    staged->valid = staged->whole
        && (frame[0] == HD_MSG_REFERENCE ? read_reference(core, frame + 1, staged->frame_n - 1)
                                         : prepare(core, hd_command(frame[0], staged->frame_n - 1), frame + 1));
    return true;
}

void hd_obey(hd_core_t *core, uint32_t now_us)
{
    const uint8_t *frame = core->receiver.bytes;
    if (!core->staged.valid) {
        if (core->staged.whole && frame[0] == HD_MSG_REFERENCE && core->staged.frame_n >= 3) {
            note_refusal(core, (uint16_t)(frame[1] | frame[2] << 8), HD_REFUSAL_MALFORMED);
        }
        refuse(core);
        return;
    }
    core->t_heard_us = now_us;
    if (frame[0] == HD_MSG_REFERENCE) {
        take_reference(core, now_us);
    } else {
        hd_command(frame[0], core->staged.frame_n - 1)->take(core, frame + 1, now_us);
    }
}

uint32_t hd_line_baud(hd_core_t *core, uint32_t now_us)
{
    if (core->baud != 0 && now_us - core->t_heard_us > HD_BAUD_HOLD_US) {
        core->baud = 0; /* the host does not follow, or has left: its next session begins at the speed of the start */
    }
    return core->baud;
}

void hd_receive(hd_core_t *core, const uint8_t *bytes, size_t n, uint32_t now_us)
{
    for (size_t i = 0; i < n; i++) {
        if (hd_hear(core, bytes[i])) {
            hd_obey(core, now_us);
        }
    }
}
