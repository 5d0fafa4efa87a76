#include "log.h"

#include <stddef.h>
#include <string.h>

#include "codec.h"

/* Beside the CRC: one of 65536 random memories would pass that alone. */
#define LOG_MARK 0x4C4F0000u

static uint32_t check_of(const hd_log_t *log)
{
    size_t after_check = offsetof(hd_log_t, events);
    return LOG_MARK | hd_crc16(0xFFFFu, (const uint8_t *)log + after_check, sizeof *log - after_check);
}

void hd_log_recover(hd_log_t *log)
{
    if (log->check != check_of(log)) {
        memset(log, 0, sizeof *log);
        log->check = check_of(log);
    }
}

void hd_log_add(hd_log_t *log, const hd_wire_log_entry_t *entry)
{
    log->entry[log->events % HD_LOG_ENTRIES] = *entry;
    log->events++;
    log->check = check_of(log);
}

void hd_log_read(const hd_log_t *log, hd_wire_log_t *wire)
{
    uint32_t n = log->events < HD_LOG_ENTRIES ? log->events : HD_LOG_ENTRIES;
    memset(wire->entry, 0, sizeof wire->entry);
    wire->events = log->events;
    wire->entries = (uint8_t)n;
    for (uint32_t i = 0; i < n; i++) {
        wire->entry[i] = log->entry[(log->events - n + i) % HD_LOG_ENTRIES];
    }
}
