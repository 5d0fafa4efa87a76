/* The way from a tick's voltages to the next tick's measurement, sample by sample: the firmware's own hd_carrier, the
 * buffers of a board, 12-bit converters and the plate between them.
 *
 * At one instant a sample is taken and then the converter's next voltage appears, to be held until the next instant. So
 * a voltage acts half a sample late, which is 5.3 degrees of the carrier at 29.2 kHz: with the amplifier's lag, all of
 * this loop's constant phase.
 */
#ifndef HD_CARRIER_LOOP_H
#define HD_CARRIER_LOOP_H

#include <stdbool.h>

#include "carrier.h"
#include "carrier_plate.h"
#include "lockstep.h"

typedef struct {
    hd_carrier_t carrier;
    hd_carrier_plate_t plate;
    hd_converter_setup_t converters;
    hd_lead_t lead[HD_MODES];
    uint64_t random;
    uint64_t samples;
    double played_v; /* of all amplifiers together, until the last sample */
    uint16_t playing[HD_CHUNK][HD_MODES];
    uint16_t next[HD_CHUNK][HD_MODES];
    uint16_t sampled[HD_CHUNK][HD_MODES];
} hd_carrier_loop_t;

/* What a board with these converters gives the carrier. */
hd_converters_t hd_board_converters(const hd_board_setup_t *setup);

/* Returns false if rates and scales make no sense. */
bool hd_carrier_loop_init(hd_carrier_loop_t *loop, const hd_board_setup_t *setup);

/* A chunk of mid-rail. */
void hd_carrier_loop_rest(uint16_t chunk[HD_CHUNK][HD_MODES]);

/* Plays `playing` into the plate and samples it into `sampled`; `next` is then played. */
void hd_carrier_loop_play(hd_carrier_loop_t *loop);

/* Plays and samples up to the end of the tick, and measures it. hd_carrier_loop_answer must follow. */
void hd_carrier_loop_listen(hd_carrier_loop_t *loop, const hd_contact_t *contact, hd_phasor_t measured_um[HD_MODES]);

/* What the core answers to the tick. */
void hd_carrier_loop_answer(hd_carrier_loop_t *loop, float drive_hz, const hd_phasor_t voltage_v[HD_MODES]);

/* What plate mode p does at the end of the tick. */
double complex hd_carrier_loop_amplitude_um(const hd_carrier_loop_t *loop, int p);

#endif
