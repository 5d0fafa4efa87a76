#include "clock.h"

#include "registers.h"
#include "setup.h"

#define INTERNAL_HZ 16000000
#define ACR_168_MHZ 0x705u /* 5 wait states; prefetch, instruction and data cache on */

/* Turns of a loop that takes at least 4 cycles at 16 MHz: 5 ms, twice what a crystal needs. */
#define WAIT_TURNS 20000

static bool reaches(reg_t *reg, uint32_t mask, uint32_t value)
{
    for (int turn = 0; turn < WAIT_TURNS; turn++) {
        if ((*reg & mask) == value) {
            return true;
        }
    }
    return false;
}

/* VCO at 336 MHz from 1 MHz: 168 for the core, 48 for a USB that is not used. */
static bool lock_pll(uint32_t input_hz, uint32_t source)
{
    RCC->CR &= ~CR_PLLON;
    if (!reaches(&RCC->CR, CR_PLLRDY, 0)) {
        return false;
    }
    RCC->PLLCFGR = input_hz / 1000000 | 336u << 6 | 0u << 16 | source | 7u << 24;
    RCC->CR |= CR_PLLON;
    return reaches(&RCC->CR, CR_PLLRDY, CR_PLLRDY);
}

static clock_source_t lock_any(void)
{
    RCC->CR |= CR_HSEON;
    if (reaches(&RCC->CR, CR_HSERDY, CR_HSERDY) && lock_pll(CRYSTAL_HZ, PLLCFGR_SRC_HSE)) {
        RCC->CR |= CR_CSSON; /* from now on a crystal that stops is a fault, not a slow drift */
        return CLOCK_CRYSTAL;
    }
    RCC->CR &= ~CR_HSEON;
    return lock_pll(INTERNAL_HZ, 0) ? CLOCK_INTERNAL : CLOCK_NONE;
}

static void count_microseconds(void)
{
    RCC->APB1ENR |= APB1_TIM5;
    (void)RCC->APB1ENR; /* the clock needs two cycles to arrive */
    TIM5->PSC = APB1_TIMER_HZ / 1000000 - 1;
    TIM5->ARR = 0xFFFFFFFFu;
    TIM5->EGR = TIM_UG;
    TIM5->CR1 = TIM_CEN;
}

clock_source_t clock_start(void)
{
    clock_source_t source = lock_any();
    if (source == CLOCK_NONE) {
        return CLOCK_NONE;
    }
    FLASH->ACR = ACR_168_MHZ;
    RCC->CFGR = CFGR_PPRE1_DIV4 | CFGR_PPRE2_DIV2;
    RCC->CFGR |= CFGR_SW_PLL;
    if (!reaches(&RCC->CFGR, CFGR_SWS, CFGR_SWS_PLL)) {
        return CLOCK_NONE;
    }
    count_microseconds();
    return source;
}
