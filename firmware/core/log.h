/* What went wrong, newest last: a ring that a reset which keeps the memory leaves readable. */
#ifndef HD_LOG_H
#define HD_LOG_H

#include <stdbool.h>
#include <stdint.h>

#include "protocol.h"

typedef struct {
    uint32_t check; /* over the rest: memory after power-up holds anything */
    uint32_t events;
    hd_wire_log_entry_t entry[HD_LOG_ENTRIES]; /* event i at i % HD_LOG_ENTRIES */
} hd_log_t;

/* Keeps a log that is undamaged, empties any other. */
void hd_log_recover(hd_log_t *log);

void hd_log_add(hd_log_t *log, const hd_wire_log_entry_t *entry);

/* The last HD_LOG_ENTRIES events, oldest first, as a LOG message has them. */
void hd_log_read(const hd_log_t *log, hd_wire_log_t *wire);

#endif
