/* The tables of all messages but REFERENCE (commands.c), and what of them is elsewhere: the session's, which the host's
 * main loop sends, in receive.c and transmit.c. */
#ifndef HD_COMMANDS_H
#define HD_COMMANDS_H

#include "core.h"

typedef struct {
    uint8_t type;  /* enum hd_message */
    uint16_t size; /* of the payload */
    void (*take)(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
    void (*prepare)(hd_core_t *core, const uint8_t *payload); /* outside the lock, for what takes too long; or NULL */
} hd_command_t;

typedef struct {
    uint8_t type;
    uint16_t size;
    bool (*fill)(hd_core_t *core, uint32_t now_us, hd_message_t *message); /* false: a stream has no more samples */
} hd_reply_t;

/* The command of this type and size of payload, or NULL. */
const hd_command_t *hd_command(uint8_t type, size_t size);

/* What a bit of `pending` is sent as. */
const hd_reply_t *hd_reply(enum hd_pending kind);

void hd_take_hello_request(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_keepalive(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_time_request(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_clear_fault(hd_core_t *core, const uint8_t *payload, uint32_t now_us);

bool hd_fill_time(hd_core_t *core, uint32_t now_us, hd_message_t *message);
bool hd_fill_hello(hd_core_t *core, uint32_t now_us, hd_message_t *message);
bool hd_fill_status(hd_core_t *core, uint32_t now_us, hd_message_t *message);

#endif
