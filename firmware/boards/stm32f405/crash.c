#include "crash.h"

#include "kept.h"
#include "registers.h"
#include "sampling.h"

#define FLASH_BEGIN 0x08000000u
#define STACKED_PC 6 /* r0-r3, r12, lr, pc, xpsr */

_Noreturn void crash(uint32_t value)
{
    sampling_silence();
    hd_wire_log_entry_t entry = {
        .t_board_us = TIM5->CNT,
        .boot_id = kept.boot_id,
        .code = HD_EVENT_CRASH,
        .mode = 255,
        .value = (float)value, /* exact: the flash has 20 bits of addresses */
    };
    hd_log_add(&kept.log, &entry);
    __asm volatile("dsb" : : : "memory");
    SCB_AIRCR = AIRCR_RESET;
    for (;;) {
    }
}

__attribute__((used)) static void crash_at(const uint32_t *frame)
{
    crash(frame[STACKED_PC] - FLASH_BEGIN);
}

__attribute__((naked)) void crash_handler(void)
{
    __asm volatile("mov r0, sp\n\tb crash_at");
}
