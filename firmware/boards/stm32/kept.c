#include "kept.h"

__attribute__((section(".noinit"))) kept_t kept;

void kept_add(uint8_t event, float value, uint32_t now_us)
{
    hd_wire_log_entry_t entry = {now_us, kept.boot_id, event, 255, value};
    hd_log_add(&kept.log, &entry);
}
