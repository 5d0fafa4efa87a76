#include "states.h"

#include <string.h>

#include "trust.h"

void hd_silence(hd_core_t *core)
{
    core->ramp = 0;
    core->drive_hz = core->follower.drive_hz;
    hd_tool_abort(&core->tool);
    hd_timeline_clear(&core->timeline);
    hd_control_reset(&core->control);
    memset(core->reference_um, 0, sizeof core->reference_um);
    memset(core->asked_um, 0, sizeof core->asked_um);
    memset(core->voltage_v, 0, sizeof core->voltage_v);
    memset(core->previous_v, 0, sizeof core->previous_v);
    for (int k = 0; k < HD_MODES; k++) {
        hd_doubts_t *doubts = &core->doubts[k]; /* one by one, as a call takes longer */
        doubts->over_amplitude = doubts->dead = doubts->backwards = doubts->clipped = doubts->swings = 0;
        doubts->answer_um_v = doubts->asked_um = doubts->spare_um2_s = (hd_phasor_t){0.0f, 0.0f};
        doubts->planned_v2 = doubts->w_um2 = 0.0f;
    }
    hd_trust_none(core);
}

void hd_enter(hd_core_t *core, enum hd_state state)
{
    if (core->state != state) {
        core->state = (uint8_t)state;
        core->pending |= HD_PENDING_STATUS; /* the host should not wait a tenth of a second to learn it */
    }
}

static void note(hd_core_t *core, uint8_t code, int mode, float value, uint32_t now_us)
{
    hd_wire_log_entry_t entry = {
        .t_board_us = now_us,
        .boot_id = core->config.boot_id,
        .code = code,
        .mode = (uint8_t)mode,
        .value = value,
    };
    hd_log_add(&core->config.log, &entry);
}

void hd_fail(hd_core_t *core, enum hd_fault fault, int mode, float value, uint32_t now_us)
{
    if (core->state != HD_STATE_FAULT) {
        core->fault = (uint8_t)fault;
        note(core, (uint8_t)fault, mode, value, now_us);
        hd_enter(core, HD_STATE_FAULT);
        hd_deadman_reset(&core->deadman);
    }
    hd_silence(core);
}

static void trip(hd_core_t *core, uint32_t now_us)
{
    core->tripped = true;
    hd_deadman_trip(&core->deadman, now_us);
    note(core, HD_EVENT_DEADMAN_TRIP, HD_ALL_MODES, 0.0f, now_us);
    hd_timeline_clear(&core->timeline); /* earlier references must not become active again */
    hd_enter(core, HD_STATE_QUIET);
    if (core->config.latch_repeated_trips && hd_deadman_repeated(&core->deadman)) {
        hd_fail(core, HD_FAULT_REPEATED_DEADMAN, HD_ALL_MODES, 0.0f, now_us);
    }
}

void hd_lose_samples(hd_core_t *core, uint32_t now_us)
{
    note(core, HD_EVENT_MISSED_CHUNK, HD_ALL_MODES, (float)++core->missed_chunks, now_us);
    hd_silence(core);
    if (core->state == HD_STATE_LIVE) {
        trip(core, now_us);
    } else if (core->state == HD_STATE_TOOL) {
        hd_enter(core, HD_STATE_QUIET);
    }
    hd_deadman_reset(&core->deadman);
}

void hd_watch_host(hd_core_t *core, uint32_t now_us)
{
    hd_deadman_tick(&core->deadman, now_us);
    if (core->state == HD_STATE_LIVE && core->deadman.starving) {
        trip(core, now_us);
    } else if (core->state == HD_STATE_TOOL && core->deadman.starving && !core->tool.stopping) {
        note(core, HD_EVENT_TOOL_STOPPED, core->tool.mode, hd_magnitude(core->tool.voltage_v), now_us);
        hd_tool_stop(&core->tool);
    } else if (hd_at_rest(core) && core->state == HD_STATE_QUIET && hd_deadman_armed(&core->deadman)) {
        core->tripped = false;
        hd_enter(core, HD_STATE_LIVE);
    }
}

bool hd_at_rest(const hd_core_t *core)
{
    return core->state != HD_STATE_LIVE && core->state != HD_STATE_TOOL && core->ramp == 0;
}

void hd_begin_tool(hd_core_t *core, uint32_t now_us)
{
    hd_enter(core, HD_STATE_TOOL);
    hd_deadman_reset(&core->deadman);
    hd_deadman_good_keepalive(&core->deadman, now_us); /* the command itself is a sign of life */
}

void hd_lose_memory(hd_core_t *core, enum hd_damage damage, uint32_t now_us)
{
    hd_fail(core, HD_FAULT_MEMORY, HD_ALL_MODES, (float)damage, now_us);
}
