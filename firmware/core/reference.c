#include "reference.h"

void hd_timeline_clear(hd_timeline_t *timeline)
{
    timeline->first = 0;
    timeline->count = 0;
    timeline->segment = 0;
    timeline->running = false;
}

static hd_polyline_t *at(hd_timeline_t *timeline, uint8_t position)
{
    return &timeline->polyline[(timeline->first + position) % HD_POLYLINES];
}

hd_polyline_t *hd_timeline_open(hd_timeline_t *timeline, uint32_t t_start_us)
{
    uint8_t waiting_from = timeline->running ? 1 : 0;
    bool pulse = false;
    while (timeline->count > waiting_from && !hd_before(at(timeline, timeline->count - 1)->t_start_us, t_start_us)) {
        timeline->count--;
        pulse = pulse || at(timeline, timeline->count)->pulse;
    }
    if (timeline->count == HD_POLYLINES) {
        timeline->count--; /* full: the newest wins over the newest before it, so what was planned first still runs */
    }
    timeline->count++;
    hd_polyline_t *opened = at(timeline, timeline->count - 1);
    opened->t_start_us = t_start_us;
    opened->pulse = pulse;
    return opened;
}

static void start_next(hd_timeline_t *timeline)
{
    if (timeline->running) {
        timeline->first = (uint8_t)((timeline->first + 1) % HD_POLYLINES);
        timeline->count--;
    }
    timeline->running = true;
    timeline->segment = 0;
}

static void start_due(hd_timeline_t *timeline, uint32_t t_us)
{
    uint8_t next = timeline->running ? 1 : 0;
    while (timeline->count > next && !hd_before(t_us, at(timeline, next)->t_start_us)) {
        start_next(timeline);
        next = 1;
    }
}

static void interpolate(const hd_knot_t *from, const hd_knot_t *to, uint32_t elapsed_us, hd_phasor_t modal_um[HD_MODES])
{
    float span_us = (float)(to->offset_us - from->offset_us);
    float frac = elapsed_us > from->offset_us ? (float)(elapsed_us - from->offset_us) / span_us : 0.0f;
    for (int k = 0; k < HD_MODES; k++) {
        modal_um[k] = hd_add(from->modal_um[k], hd_scale(frac, hd_sub(to->modal_um[k], from->modal_um[k])));
    }
}

static void hold(const hd_knot_t *knot, hd_phasor_t modal_um[HD_MODES])
{
    for (int k = 0; k < HD_MODES; k++) {
        modal_um[k] = knot->modal_um[k];
    }
}

static void follow(hd_timeline_t *timeline, const hd_polyline_t *line, uint32_t t_us, hd_phasor_t modal_um[HD_MODES])
{
    uint8_t last = (uint8_t)(line->n - 1);
    uint32_t elapsed_us = hd_before(t_us, line->t_start_us) ? 0 : t_us - line->t_start_us;
    while (timeline->segment < last && elapsed_us >= line->knot[timeline->segment + 1].offset_us) {
        timeline->segment++;
    }
    if (timeline->segment >= last) {
        hold(&line->knot[last], modal_um);
    } else {
        interpolate(&line->knot[timeline->segment], &line->knot[timeline->segment + 1], elapsed_us, modal_um);
    }
}

void hd_timeline_evaluate(hd_timeline_t *timeline, uint32_t t_us, hd_phasor_t modal_um[HD_MODES])
{
    start_due(timeline, t_us);
    const hd_polyline_t *line = hd_timeline_running(timeline);
    if (line == NULL) {
        for (int k = 0; k < HD_MODES; k++) {
            modal_um[k] = (hd_phasor_t){0.0f, 0.0f};
        }
    } else {
        follow(timeline, line, t_us, modal_um);
    }
}
