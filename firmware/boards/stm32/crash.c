#include "crash.h"

#include "board.h"
#include "kept.h"
#include "sampling.h"

#define FLASH_BEGIN 0x08000000u
#define FLASH_MAX 0x200000u
#define IN_PATH 0x800000u /* beyond any flash, and exact in the log's float */
#define STACKED_PC 6 /* r0-r3, r12, lr, pc, xpsr */

_Noreturn void crash(uint8_t event, uint32_t value)
{
    sampling_silence();
    kept_add(event, (float)value, TIM5->CNT); /* exact: an address has 24 bits at most */
    __asm volatile("dsb" : : : "memory");
    SCB_AIRCR = AIRCR_RESET;
    for (;;) {
    }
}

void crash_supply_handler(void)
{
    crash(HD_EVENT_SUPPLY, 0);
}

extern const uint32_t path_memory; /* where the instructions of chunks and ticks are */

__attribute__((used)) static void crash_at(const uint32_t *frame)
{
    uint32_t pc = frame[STACKED_PC];
    bool in_flash = pc - FLASH_BEGIN < FLASH_MAX;
    crash(HD_EVENT_CRASH, in_flash ? pc - FLASH_BEGIN : IN_PATH + pc - (uint32_t)(uintptr_t)&path_memory);
}

/* On a stack that has room: it may be that which overflowed. */
__attribute__((naked)) void crash_handler(void)
{
    __asm volatile("mov r0, sp\n\tldr sp, =stack_top\n\tb crash_at");
}
