/* TIM2 is a square wave of 1 MHz (STM32H743: 320 kHz, and its words go their own way). Its rising edge moves the DACs, its
 * falling edge starts the ADCs, so that the two never drift, and samples are taken half a period after the outputs moved. All
 * words travel by DMA; the ADCs' half and full transfer is the interrupt of the program.
 *
 * A trigger outputs what a DAC holds and only then requests the next word: a word appears one period after that of its
 * index was requested, half a period after the sample of the same index, and is held for a period.
 * CONVERTER_LAG_S accounts for it.
 */
#include "sampling.h"

#include "board.h"
#include "chip.h"
#include "setup.h"

#define CHUNK_PRIORITY 0x10 /* below the faults and the supply */
#define TICK_PRIORITY 0x20  /* below the chunks, where ticks have an interrupt of their own */
#define SETTLE_TURNS 200 /* of at least 4 cycles: 4 us, where the ADCs need 3 */

#define SYNC 10       /* PB10, the sync output */
#define AMPLIFIERS 12 /* PB12, enable: pulses, or high (ENABLE_BY_PULSES) */

void board_enable_amplifiers(bool enable)
{
    bool high = enable && !(ENABLE_BY_PULSES && (GPIOB->ODR & 1u << AMPLIFIERS) != 0);
    GPIOB->BSRR = high ? 1u << AMPLIFIERS : 1u << (AMPLIFIERS + 16);
}

void board_sync(bool high)
{
    GPIOB->BSRR = high ? 1u << SYNC : 1u << (SYNC + 16);
}

static volatile bool supply_is_off;

void sampling_forbid_drive(void)
{
    supply_is_off = true;
}

uint8_t board_interlock(void)
{
    if (REFERENCE_IS_WATCHED && supply_is_off) {
        return HD_EVENT_REFERENCE;
    }
    uint32_t open = INTERLOCK_PORT->IDR & INTERLOCKS;
    if ((open & 1u << EMERGENCY_STOP) != 0) {
        return HD_EVENT_EMERGENCY_STOP;
    }
    return open != 0 ? HD_EVENT_AMPLIFIER_FAULT : 0;
}

/* An opening circuit interrupts at once, and each tick looks besides. */
static void watch_interlocks(void)
{
    clock_on(SYSCFG_CLOCK);
    SYSCFG->EXTICR[EMERGENCY_STOP / 4] = INTERLOCK_EXTICR(AMPLIFIER_FAULT) | INTERLOCK_EXTICR(EMERGENCY_STOP);
    EXTI->RTSR |= INTERLOCKS;
    EXTI->PR = INTERLOCKS;
    EXTI->IMR |= INTERLOCKS;
}

void sampling_silence(void)
{
    GPIO_ENR |= GPIO_PORTS;
    clock_on(&RCC->APB1ENR, APB1_TIM2 | APB1_DAC);
    board_enable_amplifiers(false);
    INTERLOCK_PORT->PUPDR |= PULL_UP(AMPLIFIER_FAULT) | PULL_UP(EMERGENCY_STOP);
    INTERLOCK_PORT->MODER &= ~(ANALOGUE(AMPLIFIER_FAULT) | ANALOGUE(EMERGENCY_STOP));
    uint32_t pins = ANALOGUE(AMPLIFIERS) | ANALOGUE(BUSY) | ANALOGUE(SYNC);
    GPIOB->MODER = (GPIOB->MODER & ~pins) | OUTPUT(AMPLIFIERS) | OUTPUT(BUSY) | OUTPUT(SYNC);
    TIM2->CR1 = 0;
    converters_silence();
}

/* High for the first part of a period. It begins at the end of one, low, so that the DACs' edge is the first. */
static void start_timer(void)
{
    TIM2->PSC = 0;
    TIM2->ARR = PERIOD - 1;
    TIM2->CCR[0] = SAMPLES_AT;
    TIM2->CNT = PERIOD - 1;
    TIM2->CCMR[0] = TIM_OC1M_PWM1;
    TIM2->CR2 = TIM_MMS_OC1REF;
    for (volatile int turn = 0; turn < SETTLE_TURNS; turn++) {
    }
    TIM2->CR1 = TIM_CEN;
}

static void accept_interrupt(int irq, uint8_t priority)
{
    NVIC_IPR[irq] = priority;
    NVIC_ICPR[irq / 32] = 1u << irq % 32; /* a chunk of before a restart is none */
    NVIC_ISER[irq / 32] = 1u << irq % 32;
}

void sampling_run(void)
{
    static const uint8_t failures[] = {IRQS_TRANSFER_ERROR};
    converters_start();
    for (unsigned i = 0; i < sizeof failures; i++) {
        accept_interrupt(failures[i], CHUNK_PRIORITY);
    }
    watch_interlocks();
    accept_interrupt(IRQ_INTERLOCK, TICK_CHUNKS_LATE > 0 ? TICK_PRIORITY : CHUNK_PRIORITY); /* not amid a tick */
    if (TICK_CHUNKS_LATE > 0) {
        SCB_SHPR3 = SHPR3_PENDSV(TICK_PRIORITY);
    }
    accept_interrupt(IRQ_CHUNK, CHUNK_PRIORITY);
    start_timer();
    sampling_feed_window_watchdog();
}

/* By way of the peripherals' own reset: a DAC that missed its DMA stops its requests, and an ADC that was overrun neither. */
void sampling_restart(void)
{
    sampling_silence();
    converters_stop();
    sampling_silence();
    sampling_run();
}

void board_lock(void)
{
    __asm volatile("msr basepri, %0\n\tisb" : : "r"(CHUNK_PRIORITY) : "memory");
}

void board_unlock(void)
{
    __asm volatile("msr basepri, %0" : : "r"(0) : "memory");
}
