#include "log.h"

#include <stddef.h>
#include <string.h>

#include "phasor.h"

#define WORDS ((sizeof(hd_log_t) - offsetof(hd_log_t, events)) / sizeof(uint32_t))

_Static_assert(offsetof(hd_log_t, events) + WORDS * sizeof(uint32_t) == sizeof(hd_log_t), "the check is over whole words");

/* FNV-1a by words: a tick that adds an entry has no time for a CRC, and it only has to distinguish a log from noise. */
static uint32_t check_of(const hd_log_t *log)
{
    const uint8_t *bytes = (const uint8_t *)log + offsetof(hd_log_t, events);
    uint32_t word, check = 2166136261u;
    for (size_t i = 0; i < WORDS; i++) {
        memcpy(&word, bytes + i * sizeof word, sizeof word);
        check = (check ^ word) * 16777619u;
    }
    return check;
}

void hd_log_recover(hd_log_t *log)
{
    if (log->check != check_of(log)) {
        memset(log, 0, sizeof *log);
        log->check = check_of(log);
    }
}

/* Lost samples come in swarms, and their value counts them: one entry of a swarm is enough, and leaves room for what
 * went wrong before it. */
static bool amends_newest(const hd_log_t *log, const hd_wire_log_entry_t *entry)
{
    const hd_wire_log_entry_t *newest = &log->entry[(log->events - 1) % HD_LOG_ENTRIES];
    return log->events > 0 && entry->code == HD_EVENT_MISSED_CHUNK && newest->code == entry->code
        && newest->boot_id == entry->boot_id;
}

void hd_log_add(hd_log_t *log, const hd_wire_log_entry_t *entry)
{
    if (amends_newest(log, entry)) {
        log->entry[(log->events - 1) % HD_LOG_ENTRIES] = *entry;
    } else {
        log->entry[log->events % HD_LOG_ENTRIES] = *entry;
        log->events++;
    }
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
        wire->entry[i].value = hd_sendable(wire->entry[i].value); /* a magnitude is infinite above 1.8e19 */
    }
}
