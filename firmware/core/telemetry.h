/* Samples of the control tick for a person to look at: a ring between the tick that makes them and the line that may
 * be too slow for them. When it is full the oldest sample goes and is counted: what arrives is news. */
#ifndef HD_TELEMETRY_H
#define HD_TELEMETRY_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol.h"

#define HD_TELEMETRY_SAMPLES 16 /* 8 ms at 2 kHz: longer than any other message keeps the line */

typedef struct {
    hd_wire_telemetry_t sample[HD_TELEMETRY_SAMPLES];
    uint8_t first;
    uint8_t count;
    uint16_t divisor; /* control ticks for one sample; 0 while there is no stream */
    uint16_t ticks;   /* since the last sample */
    uint32_t dropped;
} hd_telemetry_t;

/* Begins a stream at the highest rate not above `rate_hz` that divides the control rate, or ends it for 0. */
void hd_telemetry_start(hd_telemetry_t *telemetry, uint16_t rate_hz, float control_hz);

/* Once in every control tick: true if this one is to be sampled. */
bool hd_telemetry_due(hd_telemetry_t *telemetry);

void hd_telemetry_push(hd_telemetry_t *telemetry, const hd_wire_telemetry_t *sample);

/* Takes the oldest sample, with `dropped` as it stands; false if there is none. */
bool hd_telemetry_pop(hd_telemetry_t *telemetry, hd_wire_telemetry_t *sample);

#endif
