#include "codec.h"

#define CRC_START 0xFFFFu
#define COBS_BLOCK 0xFFu /* a code of 255: 254 bytes follow and no zero is implied */

/* Polynomial 0x1021, four bits at a time: 32 bytes of table where the target has flash to save. */
uint16_t hd_crc16(uint16_t crc, const uint8_t *bytes, size_t n)
{
    static const uint16_t nibble[16] = {
        0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7,
        0x8108, 0x9129, 0xA14A, 0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF,
    };
    for (size_t i = 0; i < n; i++) {
        crc = (uint16_t)((crc << 4) ^ nibble[(crc >> 12) ^ (bytes[i] >> 4)]);
        crc = (uint16_t)((crc << 4) ^ nibble[(crc >> 12) ^ (bytes[i] & 0x0Fu)]);
    }
    return crc;
}

/* In place: a decoded byte never lies ahead of the code it came from. Returns 0 for what COBS cannot have produced. */
static size_t cobs_decode(uint8_t *bytes, size_t n)
{
    size_t in = 0, out = 0;
    while (in < n) {
        size_t code = bytes[in++];
        if (code - 1 > n - in) {
            return 0;
        }
        for (size_t i = 1; i < code; i++) {
            bytes[out++] = bytes[in++];
        }
        if (code < COBS_BLOCK && in < n) {
            bytes[out++] = 0;
        }
    }
    return out;
}

static size_t frame_length(hd_receiver_t *receiver)
{
    size_t n = receiver->overflow ? 0 : cobs_decode(receiver->bytes, receiver->n);
    if (n < 3) {
        return 0;
    }
    uint16_t sent = (uint16_t)(receiver->bytes[n - 2] | receiver->bytes[n - 1] << 8);
    return hd_crc16(CRC_START, receiver->bytes, n - 2) == sent ? n - 2 : 0;
}

hd_rx_t hd_receiver_push(hd_receiver_t *receiver, uint8_t byte, size_t *frame_n)
{
    if (byte != 0) {
        if (receiver->n < sizeof receiver->bytes) {
            receiver->bytes[receiver->n++] = byte;
        } else {
            receiver->overflow = true;
        }
        return HD_RX_PENDING;
    }
    bool empty = receiver->n == 0; /* hosts may send a delimiter first to close what was on the line before them */
    *frame_n = empty ? 0 : frame_length(receiver);
    receiver->n = 0;
    receiver->overflow = false;
    if (empty) {
        return HD_RX_PENDING;
    }
    return *frame_n != 0 ? HD_RX_FRAME : HD_RX_DAMAGED;
}

typedef struct {
    uint8_t *out;
    size_t n;
    size_t code; /* where the open block's length goes */
} cobs_writer_t;

static void cobs_open_block(cobs_writer_t *w)
{
    w->code = w->n++;
    w->out[w->code] = 1;
}

static void cobs_write(cobs_writer_t *w, const uint8_t *bytes, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (w->out[w->code] == COBS_BLOCK) {
            cobs_open_block(w);
        }
        if (bytes[i] == 0) {
            cobs_open_block(w);
        } else {
            w->out[w->n++] = bytes[i];
            w->out[w->code]++;
        }
    }
}

size_t hd_frame_encode(uint8_t type, const void *payload, size_t n, uint8_t *out)
{
    uint16_t crc = hd_crc16(hd_crc16(CRC_START, &type, 1), payload, n);
    const uint8_t tail[2] = {(uint8_t)crc, (uint8_t)(crc >> 8)};
    cobs_writer_t w = {.out = out};
    cobs_open_block(&w);
    cobs_write(&w, &type, 1);
    cobs_write(&w, payload, n);
    cobs_write(&w, tail, sizeof tail);
    out[w.n++] = 0;
    return w.n;
}
