/* From reset to main: the vector table, memory, the floating-point unit. */
#include <stdint.h>

#include "registers.h"

extern uint32_t data_load[], data_start[], data_end[], bss_start[], bss_end[], stack_top[];

int main(void);
void reset_handler(void);
void tim3_handler(void);
void usart1_handler(void);
void usart2_handler(void);

/* A fault stops the emulated board for a debugger; the host detects the timeout. */
static void stop(void)
{
    for (;;) {
        __asm volatile("wfi");
    }
}

void reset_handler(void)
{
    SCB_CPACR |= CPACR_FPU;
    __asm volatile("dsb\n isb" ::: "memory");
    for (uint32_t *to = data_start, *from = data_load; to < data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = bss_start; to < bss_end;) {
        *to++ = 0;
    }
    main();
    stop();
}

typedef void (*handler_t)(void);

typedef struct {
    uint32_t *stack;
    handler_t exception[15];
    handler_t irq[IRQS];
} vectors_t;

__attribute__((section(".vectors"), used)) static const vectors_t VECTORS = {
    .stack = stack_top,
    .exception = {reset_handler, stop, stop, stop, stop, stop, 0, 0, 0, 0, stop, stop, 0, stop, stop},
    .irq = {[TIM3_IRQ] = tim3_handler, [USART1_IRQ] = usart1_handler, [USART2_IRQ] = usart2_handler},
};
