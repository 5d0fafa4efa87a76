/* TIM2's update event triggers the DACs and the ADCs in the same cycle, so that the two never drift. One 32-bit stream
 * carries each pair: memory to DHR12LD for both DACs, CDR to memory for both ADCs. The ADC's half and full transfer are
 * the only interrupt of the program.
 *
 * A trigger outputs DHR12LD and only then requests the next word: a sample appears one trigger after its
 * twin of the same index was taken, and is held for another. CONVERTER_LAG_S in board.c accounts for it.
 */
#include "sampling.h"

#include "board.h"
#include "clock.h"
#include "registers.h"

_Static_assert(HD_MODES == 2, "the STM32F405 has two DACs; three modes need another converter");

#define WORDS (2 * HD_CHUNK)
#define CHUNK_PRIORITY 0x10 /* below the faults, above nothing: it is alone */
#define ADC1_PIN 1          /* PA1, ADC1_IN1 */
#define ADC2_PIN 2          /* PA2, ADC2_IN2 */
#define STOP_TURNS 1000
#define SETTLE_TURNS 200 /* of at least 4 cycles: 5 us, where the ADCs need 3 */

#define ANALOGUE(pin) (3u << 2 * (pin))
#define OUTPUT(pin) (1u << 2 * (pin))
#define AMPLIFIERS 12 /* PB12, high to enable */
#define BUSY 13       /* PB13, high while the interrupt works: its duty cycle is the load */

/* [half][sample][mode]; the DMA cannot reach the core-coupled memory */
static _Alignas(uint32_t) uint16_t sampled[2][HD_CHUNK][HD_MODES];
static _Alignas(uint32_t) uint16_t played[2][HD_CHUNK][HD_MODES];

void sampling_enable_amplifiers(bool enable)
{
    GPIOB->BSRR = enable ? 1u << AMPLIFIERS : 1u << (AMPLIFIERS + 16);
}

void sampling_silence(void)
{
    RCC->AHB1ENR |= AHB1_GPIOA | AHB1_GPIOB;
    RCC->APB1ENR |= APB1_TIM2 | APB1_DAC;
    (void)RCC->APB1ENR; /* the clocks need two cycles to arrive */
    sampling_enable_amplifiers(false);
    GPIOB->MODER = (GPIOB->MODER & ~(ANALOGUE(AMPLIFIERS) | ANALOGUE(BUSY))) | OUTPUT(AMPLIFIERS) | OUTPUT(BUSY);
    TIM2->CR1 = 0;
    DAC->DHR12LD = HD_MID_RAIL << 16 | HD_MID_RAIL;
    DAC->CR = DAC_BOTH(DAC_EN); /* no trigger: what was written is put out in the next cycle */
    GPIOA->MODER |= ANALOGUE(4) | ANALOGUE(5) | ANALOGUE(ADC1_PIN) | ANALOGUE(ADC2_PIN);
}

static void stop_stream(dma_stream_t *stream)
{
    stream->CR = 0;
    for (int turn = 0; turn < STOP_TURNS && (stream->CR & DMA_EN) != 0; turn++) {
        /* the word under way is finished first */
    }
}

static void start_stream(dma_stream_t *stream, reg_t *peripheral, void *memory, uint32_t flags)
{
    stream->PAR = (uint32_t)(uintptr_t)peripheral;
    stream->M0AR = (uint32_t)(uintptr_t)memory;
    stream->NDTR = WORDS;
    stream->FCR = 0; /* direct: no FIFO whose fill would be one more delay */
    stream->CR = DMA_WORDS | DMA_MINC | DMA_CIRC | DMA_PRIORITY(3) | flags;
    __asm volatile("dsb" : : : "memory"); /* what the stream will read is written */
    stream->CR |= DMA_EN;
}

static void start_dacs(void)
{
    for (int i = 0; i < WORDS; i++) {
        for (int k = 0; k < HD_MODES; k++) {
            played[i / HD_CHUNK][i % HD_CHUNK][k] = HD_MID_RAIL;
        }
    }
    DMA1->HIFCR = DMA_ALL << 6; /* stream 5 */
    start_stream(&DMA1->STREAM[5], &DAC->DHR12LD, played, DMA_CHANNEL(7) | DMA_TO_PERIPHERAL);
    DAC->CR = DAC_BOTH(DAC_EN | DAC_TEN | DAC_TSEL_TIM2) | DAC_DMAEN;
}

/* 21 MHz, 3 cycles to sample and 12 to convert: 0.71 us of each 1 us. */
static void start_adcs(void)
{
    ADC->CCR = ADC_PRE_DIV4 | ADC_DMA_PAIRS | ADC_DDS | ADC_MULTI_SIMULTANEOUS;
    ADC1->SQR3 = ADC1_PIN;
    ADC2->SQR3 = ADC2_PIN;
    ADC2->CR2 = ADC_ALIGN_LEFT | ADC_ADON;
    ADC1->CR2 = ADC_ALIGN_LEFT | ADC_EXTSEL_TIM2_TRGO | ADC_EXTEN_RISING | ADC_ADON;
    DMA2->LIFCR = DMA_ALL; /* stream 0 */
    start_stream(&DMA2->STREAM[0], &ADC->CDR, sampled, DMA_CHANNEL(0) | DMA_HTIE | DMA_TCIE);
}

static void start_timer(void)
{
    TIM2->PSC = 0;
    TIM2->ARR = APB1_TIMER_HZ / HD_SAMPLE_HZ - 1;
    TIM2->CR2 = TIM_MMS_UPDATE;
    TIM2->CNT = 0;
    for (volatile int turn = 0; turn < SETTLE_TURNS; turn++) {
    }
    TIM2->CR1 = TIM_CEN;
}

void sampling_run(void)
{
    RCC->AHB1ENR |= AHB1_DMA1 | AHB1_DMA2;
    RCC->APB2ENR |= APB2_ADC1 | APB2_ADC2;
    (void)RCC->APB2ENR;
    start_dacs();
    start_adcs();
    NVIC_IPR[IRQ_DMA2_STREAM0] = CHUNK_PRIORITY;
    NVIC_ICPR[IRQ_DMA2_STREAM0 / 32] = 1u << IRQ_DMA2_STREAM0 % 32; /* a chunk of before a restart is none */
    NVIC_ISER[IRQ_DMA2_STREAM0 / 32] = 1u << IRQ_DMA2_STREAM0 % 32;
    start_timer();
}

/* From the beginning, by way of the peripherals' own reset: a DAC that missed its DMA stops its requests, and an ADC
 * that was overrun neither. */
static void restart(void)
{
    hd_on_missed_chunk();
    sampling_silence();
    stop_stream(&DMA1->STREAM[5]);
    stop_stream(&DMA2->STREAM[0]);
    RCC->APB2RSTR = APB2_ADC1;
    RCC->APB1RSTR = APB1_DAC | APB1_TIM2;
    RCC->APB2RSTR = 0;
    RCC->APB1RSTR = 0;
    sampling_silence();
    sampling_run();
}

/* The streams run in step, the DACs' one or two words ahead: it has fetched what the next trigger will put out. */
static bool in_step(void)
{
    uint32_t lead = (DMA2->STREAM[0].NDTR - DMA1->STREAM[5].NDTR + WORDS) % WORDS;
    return lead <= 2 && (DAC->SR & DAC_SR_DMAUDR1) == 0 && ((ADC1->SR | ADC2->SR) & ADC_SR_OVR) == 0;
}

void DMA2_Stream0_IRQHandler(void);
void DMA2_Stream0_IRQHandler(void)
{
    GPIOB->BSRR = 1u << BUSY;
    uint32_t raised = DMA2->LISR & DMA_ALL;
    DMA2->LIFCR = raised; /* and not what comes between the two: that would be a chunk lost unseen */
    uint32_t event = raised & ~DMA_FE; /* without FIFO its flag means nothing */
    if ((event == DMA_HT || event == DMA_TC) && in_step()) {
        int half = event == DMA_TC;
        hd_on_chunk((const uint16_t(*)[HD_MODES])sampled[half], (uint16_t(*)[HD_MODES])played[half]);
    } else {
        event = 0;
    }
    /* The other half's event now would mean that the DACs play what was just being filled. */
    if (event == 0 || (DMA2->LISR & (DMA_HT | DMA_TC)) != 0) {
        restart();
    }
    GPIOB->BSRR = 1u << (BUSY + 16);
}

void sampling_lock(void)
{
    __asm volatile("msr basepri, %0\n\tisb" : : "r"(CHUNK_PRIORITY) : "memory");
}

void sampling_unlock(void)
{
    __asm volatile("msr basepri, %0" : : "r"(0) : "memory");
}
