/* Memory that a reset leaves as it was, and power-up fills with noise. */
#ifndef HD_STM32_KEPT_H
#define HD_STM32_KEPT_H

#include <stdint.h>

#include "log.h"

typedef struct {
    uint32_t boots; /* from an arbitrary beginning */
    uint32_t boot_id;
    hd_log_t log;
} kept_t;

extern kept_t kept;

/* Adds an event of this boot to the log. */
void kept_add(uint8_t event, float value, uint32_t now_us);

#endif
