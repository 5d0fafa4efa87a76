/* Frames on the serial line: COBS (Cheshire and Baker, 1999), CRC-16/CCITT-FALSE, delimiter 0x00. */
#ifndef HD_CODEC_H
#define HD_CODEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "protocol.h"

typedef enum {
    HD_RX_PENDING, /* the frame goes on */
    HD_RX_FRAME,   /* a whole, undamaged frame stands in `bytes` */
    HD_RX_DAMAGED, /* a delimiter came and what was before it is not a frame */
} hd_rx_t;

typedef struct {
    uint8_t bytes[HD_LINE_SIZE(HD_FRAME_MAX)];
    size_t n;
    bool overflow;
} hd_receiver_t;

/* Takes one byte from the line. After HD_RX_FRAME, bytes[0] is the type, bytes[1 .. n-1] the payload, until the next
 * push. */
hd_rx_t hd_receiver_push(hd_receiver_t *receiver, uint8_t byte, size_t *frame_n);

/* Writes the frame of `type` and `payload` with its delimiter; `out` must hold HD_LINE_SIZE(1 + n + 2). Returns its
 * length. */
size_t hd_frame_encode(uint8_t type, const void *payload, size_t n, uint8_t *out);

uint16_t hd_crc16(uint16_t crc, const uint8_t *bytes, size_t n);

#endif
