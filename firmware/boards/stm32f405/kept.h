/* Memory that a reset leaves as it was, and power-up fills with noise. */
#ifndef HD_F405_KEPT_H
#define HD_F405_KEPT_H

#include <stdint.h>

#include "log.h"

typedef struct {
    uint32_t boots; /* from an arbitrary beginning */
    uint32_t boot_id;
    hd_log_t log;
} kept_t;

extern kept_t kept;

#endif
