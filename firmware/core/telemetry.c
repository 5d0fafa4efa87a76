#include "telemetry.h"

void hd_telemetry_start(hd_telemetry_t *telemetry, uint16_t rate_hz, float control_hz)
{
    telemetry->first = telemetry->count = 0;
    telemetry->divisor = telemetry->ticks = 0;
    telemetry->dropped = 0;
    if (rate_hz > 0) {
        uint32_t whole = (uint32_t)(control_hz / (float)rate_hz);
        bool exact = (float)whole * (float)rate_hz >= control_hz;
        telemetry->divisor = (uint16_t)(exact ? whole : whole + 1);
    }
}

bool hd_telemetry_due(hd_telemetry_t *telemetry)
{
    if (telemetry->divisor == 0 || ++telemetry->ticks < telemetry->divisor) {
        return false;
    }
    telemetry->ticks = 0;
    return true;
}

void hd_telemetry_push(hd_telemetry_t *telemetry, const hd_wire_telemetry_t *sample)
{
    if (telemetry->count == HD_TELEMETRY_SAMPLES) {
        telemetry->first = (uint8_t)((telemetry->first + 1) % HD_TELEMETRY_SAMPLES);
        telemetry->count--;
        telemetry->dropped++;
    }
    telemetry->sample[(telemetry->first + telemetry->count) % HD_TELEMETRY_SAMPLES] = *sample;
    telemetry->count++;
}

bool hd_telemetry_pop(hd_telemetry_t *telemetry, hd_wire_telemetry_t *sample)
{
    if (telemetry->count == 0) {
        return false;
    }
    *sample = telemetry->sample[telemetry->first];
    sample->dropped = telemetry->dropped;
    telemetry->first = (uint8_t)((telemetry->first + 1) % HD_TELEMETRY_SAMPLES);
    telemetry->count--;
    return true;
}
