/* The commands of a person at the bench, as receive.c hands them over: payloads of their proper length. */
#ifndef HD_COMMANDS_H
#define HD_COMMANDS_H

#include "core.h"

/* Outside the lock: computes the requested design, if its values are in range. */
void hd_prepare_set_controller(hd_core_t *core, const uint8_t *payload);
void hd_prepare_set_model(hd_core_t *core, const uint8_t *payload);
void hd_prepare_set_wiring(hd_core_t *core, const uint8_t *payload);
void hd_prepare_set_drive(hd_core_t *core, const uint8_t *payload);

void hd_take_set_controller(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_set_model(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_set_wiring(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_controller_request(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_set_drive(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_set_baud(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_sweep(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_raw_voltage(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_set_telemetry(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_log_request(hd_core_t *core, const uint8_t *payload, uint32_t now_us);
void hd_take_stop(hd_core_t *core, const uint8_t *payload, uint32_t now_us);

#endif
