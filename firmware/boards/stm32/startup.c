/* From the reset to main, and from a fault back to the reset. */
#include <stdint.h>

#include "crash.h"
#include "interrupts.h"
#include "registers.h"
#include "sampling.h"
#include "tick.h"

extern uint32_t stack_top, stack_guard, table_begin, table_end, path_begin, path_end, data_begin, data_end, bss_begin, bss_end;
extern const uint32_t table_load, path_load, data_load;

int main(void);
void Reset_Handler(void);

static void load(uint32_t *to, const uint32_t *end, const uint32_t *from)
{
    while (to != from && to < end) { /* what runs from the flash is there already */
        *to++ = *from++;
    }
}

/* A stack that grows into the variables is a fault. */
static void guard_stack(void)
{
    MPU_RNR = 0;
    MPU_RBAR = (uint32_t)(uintptr_t)&stack_guard;
    MPU_RASR = MPU_NO_ACCESS_32_BYTES;
    MPU_CTRL = MPU_ENABLE;
    __asm volatile("dsb\n\tisb" : : : "memory");
}

/* The converters come first: until then their pins float. Memory is copied at 16 MHz, which takes a millisecond. */
void Reset_Handler(void)
{
    SCB_CPACR |= CPACR_FPU; /* with lazy stacking, as after every reset: an interrupt saves what it uses */
    __asm volatile("dsb\n\tisb" : : : "memory");
    sampling_silence();
    load(&table_begin, &table_end, &table_load);
    load(&path_begin, &path_end, &path_load);
    load(&data_begin, &data_end, &data_load);
    for (uint32_t *word = &bss_begin; word < &bss_end; word++) {
        *word = 0;
    }
    guard_stack();
    main();
}

typedef void (*vector_t)(void);

#pragma GCC diagnostic ignored "-Woverride-init" /* the few that may happen, among all that should not */
__attribute__((section(".vectors"), used)) static const vector_t vectors[16 + IRQ_LAST + 1] = {
    [0] = (vector_t)(uintptr_t)&stack_top,
    [1] = Reset_Handler,
    [2 ... 16 + IRQ_LAST] = crash_handler, /* 2: the crystal stopped; 3: a fault */
    [16 + IRQ_PVD] = crash_supply_handler,
    VECTORS_TRANSFER_ERROR(on_transfer_error)
    VECTOR_TICK
    [16 + IRQ_INTERLOCK] = on_interlock,
    [16 + IRQ_CHUNK] = on_chunk,
};
