#include "crash.h"

#include "board.h"
#include "chip.h"
#include "kept.h"
#include "sampling.h"

#define FLASH_BEGIN 0x08000000u
#define CCM_BEGIN 0x10000000u
#define IN_CCM 0x800000u /* beyond any flash, and exact in the log's float */
#define STACKED_PC 6 /* r0-r3, r12, lr, pc, xpsr */

_Noreturn void crash(uint8_t event, uint32_t value)
{
    sampling_silence();
    kept_add(event, (float)value, TIM5->CNT); /* exact: the flash has 20 bits of addresses */
    __asm volatile("dsb" : : : "memory");
    SCB_AIRCR = AIRCR_RESET;
    for (;;) {
    }
}

void crash_supply_handler(void)
{
    crash(HD_EVENT_SUPPLY, 0);
}

__attribute__((used)) static void crash_at(const uint32_t *frame)
{
    uint32_t pc = frame[STACKED_PC];
    crash(HD_EVENT_CRASH, pc < CCM_BEGIN ? pc - FLASH_BEGIN : IN_CCM + pc - CCM_BEGIN);
}

/* On a stack that has room: it may be that which overflowed. */
__attribute__((naked)) void crash_handler(void)
{
    __asm volatile("mov r0, sp\n\tldr sp, =stack_top\n\tb crash_at");
}
