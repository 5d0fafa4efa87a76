#include "clock.h"

#include "chip.h"
#include "setup.h"
#include "wait.h"

static bool lock_pll(uint32_t config)
{
    RCC->CR &= ~CR_PLLON;
    if (!reaches(&RCC->CR, CR_PLLRDY, 0)) {
        return false;
    }
    SET_PLL(config);
    RCC->CR |= CR_PLLON;
    return reaches(&RCC->CR, CR_PLLRDY, CR_PLLRDY);
}

static clock_source_t lock_any(void)
{
    RCC->CR |= CLOCK_AT_OSC_IN ? CR_HSEBYP : 0; /* before it is switched on: RM0090, 7.3.1; RM0440, 7.4.1; RM0433, RCC_CR */
    RCC->CR |= CR_HSEON;
    if (reaches(&RCC->CR, CR_HSERDY, CR_HSERDY) && lock_pll(PLL_CONFIG(CRYSTAL_HZ, PLL_CRYSTAL))) {
        RCC->CR |= CR_CSSON; /* from now on a crystal that stops is a fault, not a slow drift */
        return CLOCK_CRYSTAL;
    }
    RCC->CR &= ~CR_HSEON;
    return lock_pll(PLL_CONFIG(INTERNAL_HZ, PLL_INTERNAL)) ? CLOCK_INTERNAL : CLOCK_NONE;
}

static void count_microseconds(void)
{
    clock_on(&RCC->APB1ENR, APB1_TIM5);
    TIM5->PSC = TIMER_HZ / 1000000 - 1;
    TIM5->ARR = 0xFFFFFFFFu;
    TIM5->EGR = TIM_UG;
    TIM5->CR1 = TIM_CEN;
}

clock_source_t clock_start(void)
{
    clock_source_t source = lock_any();
    if (source == CLOCK_NONE || !chip_use_pll()) {
        return CLOCK_NONE;
    }
    count_microseconds();
    return source;
}
