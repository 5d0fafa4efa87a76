/* The STM32F405's clocks, converters and line. One 32-bit stream carries each pair: memory to DHR12RD for both DACs, CDR
 * to memory for both ADCs. */
#include "chip.h"

#include "setup.h"
#include "wait.h"

_Static_assert(HD_MODES == 2, "the STM32F405 has two DACs; three modes need the STM32G474");
_Static_assert(CRYSTAL_HZ % 1000000 == 0 && CRYSTAL_HZ >= 4000000 && CRYSTAL_HZ <= 26000000, "the PLL needs 1 MHz");
_Static_assert(LINK_BAUD >= HD_BAUD_MIN && LINK_BAUD_MAX <= 5250000, "USART1 at 84 MHz, 16 samples a bit");

#define BAUD_DIVIDER(baud) ((APB2_HZ + (baud) / 2) / (baud)) /* 16 samples a bit: in 1/16 of APB2_HZ / 16 */
#define WORDS (2 * HD_CHUNK)
#define ADC1_PIN 1 /* PA1, ADC1_IN1 */
#define ADC2_PIN 2 /* PA2, ADC2_IN2 */
#define DACS (&DMA1->STREAM[5])
#define ADCS (&DMA2->STREAM[0])

/* [half][sample][mode]; the DMA cannot reach the core-coupled memory */
static _Alignas(uint32_t) uint16_t sampled[2][HD_CHUNK][HD_MODES];
static _Alignas(uint32_t) uint16_t played[2][HD_CHUNK][HD_MODES];

bool chip_use_pll(void)
{
    FLASH->ACR = ACR_168_MHZ;
    RCC->CFGR = CFGR_PPRE1_DIV4 | CFGR_PPRE2_DIV2;
    RCC->CFGR |= CFGR_SW_PLL;
    return reaches(&RCC->CFGR, CFGR_SWS, CFGR_SW_PLL << 2);
}

bool chip_guards_brown_out(void)
{
    return (FLASH->OPTCR & OPTCR_BOR_OFF) == OPTCR_BOR_LEVEL_3;
}

bool chip_watch_supply(void)
{
    PWR->CR |= PWR_PLS_2V9 | PWR_PVDE;
    return reaches(&PWR->CSR, PWR_PVDO, 0);
}

void converters_silence(void)
{
    DAC->DHR12RD = HD_MID_RAIL << 16 | HD_MID_RAIL;
    DAC->CR = DAC_BOTH(DAC_EN); /* no trigger: what was written is put out in the next cycle */
    GPIOA->MODER |= ANALOGUE(4) | ANALOGUE(5) | ANALOGUE(ADC1_PIN) | ANALOGUE(ADC2_PIN);
}

static void start_stream(dma_stream_t *stream, reg_t *peripheral, void *memory, uint32_t flags)
{
    stream->PAR = (uint32_t)(uintptr_t)peripheral;
    stream->M0AR = (uint32_t)(uintptr_t)memory;
    stream->NDTR = WORDS;
    stream->FCR = 0; /* direct: no FIFO whose fill would be one more delay */
    stream->CR = DMA_WORDS | DMA_MINC | DMA_CIRC | DMA_PRIORITY(3) | DMA_TEIE | flags;
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
    start_stream(DACS, &DAC->DHR12RD, played, DMA_CHANNEL(7) | DMA_TO_PERIPHERAL);
    DAC->CR = DAC_BOTH(DAC_EN | DAC_TEN | DAC_TSEL_TIM2) | DAC_DMAEN;
}

/* 21 MHz, 3 cycles to sample and 12 to convert: 0.71 us of each 1 us; the next choice, 15 to sample, would take 1.29. In 143 ns
 * the converter's own 4 pF behind at most 6 kOhm (DS8626, ADC characteristics) settle to 0.3 %, the same share of every sample,
 * if a capacitor of some nF at the pin holds it: a constant gain and phase, which calibration measures. */
static void start_adcs(void)
{
    ADC->CCR = ADC_PRE_DIV4 | ADC_DMA_PAIRS | ADC_DDS | ADC_MULTI_SIMULTANEOUS;
    ADC1->SQR3 = ADC1_PIN;
    ADC2->SQR3 = ADC2_PIN;
    ADC2->CR2 = ADC_ADON;
    ADC1->CR2 = ADC_EXTSEL_TIM2_TRGO | ADC_EXTEN_FALLING | ADC_ADON;
    DMA2->LIFCR = DMA_ALL; /* stream 0 */
    start_stream(ADCS, &ADC->CDR, sampled, DMA_CHANNEL(0) | DMA_HTIE | DMA_TCIE);
}

/* DMA2's streams read and write peripherals of APB2 alone, none of AHB (ES0182 rev 14, 2.2.19). */
void converters_start(void)
{
    RCC->AHB1ENR |= AHB1_DMA1 | AHB1_DMA2;
    RCC->APB2ENR |= APB2_ADC1 | APB2_ADC2;
    (void)RCC->APB2ENR;
    start_dacs();
    start_adcs();
}

float reference_reading(void)
{
    ADC1->CR2 = ADC_ADON | ADC_SWSTART;
    return reaches(&ADC1->SR, ADC_SR_EOC, ADC_SR_EOC) ? (float)ADC1->DR : 0.0f;
}

void reference_start(void)
{
    RCC->APB2ENR |= APB2_ADC1;
    (void)RCC->APB2ENR;
    ADC->CCR = ADC_PRE_DIV4 | ADC_TSVREFE;
    ADC1->SMPR1 = ADC_SAMPLE_480;
    ADC1->SQR3 = ADC_VREFINT;
    ADC1->CR2 = ADC_ADON;
    for (volatile int turn = 0; turn < REFERENCE_TURNS; turn++) {
    }
}

void reference_stop(void)
{
    RCC->APB2RSTR = APB2_ADC1; /* as they were */
    RCC->APB2RSTR = 0;
}

void converters_stop(void)
{
    DACS->CR = 0;
    ADCS->CR = 0;
    (void)reaches(&DACS->CR, DMA_EN, 0); /* the word under way is finished first */
    (void)reaches(&ADCS->CR, DMA_EN, 0);
    RCC->APB2RSTR = APB2_ADC1;
    RCC->APB1RSTR = APB1_DAC | APB1_TIM2;
    RCC->APB2RSTR = 0;
    RCC->APB1RSTR = 0;
}

/* The DACs' stream is one or two words ahead: it has fetched what the next trigger will put out. */
bool converters_in_step(void)
{
    uint32_t lead = ADCS->NDTR - DACS->NDTR;
    return (lead <= 2 || lead + WORDS <= 2) && (DAC->SR & DAC_UNDERRUNS) == 0 && ((ADC1->SR | ADC2->SR) & ADC_SR_OVR) == 0;
}

bool converters_listen(hd_carrier_t *carrier, int half)
{
    return hd_carrier_listen(carrier, (const uint16_t(*)[HD_MODES])sampled[half]);
}

void converters_speak(hd_carrier_t *carrier, int half)
{
    hd_carrier_speak(carrier, played[half]);
}

/* PA9 is also VBUS of the chip's USB: a board that has a capacitor there (STM32F4DISCOVERY, UM1472: 4.7 uF) ends the line. */
void serial_start(void)
{
    RCC->AHB1ENR |= GPIO_A | AHB1_DMA2;
    RCC->APB2ENR |= APB2_USART1;
    (void)RCC->APB2ENR;
    GPIOA->PUPDR |= PULL_UP(10); /* an open input is a line at rest, not noise */
    GPIOA->AFR[1] |= FUNCTION(9, 7) | FUNCTION(10, 7);
    GPIOA->MODER |= ALTERNATE(9) | ALTERNATE(10);
    USART1->BRR = BAUD_DIVIDER(LINK_BAUD);
    USART1->CR3 = USART_DMAR | USART_DMAT;
    USART1->CR1 = USART_UE | USART_RE | USART_TE;
}

bool serial_set_baud(uint32_t baud)
{
    bool idle = (USART1->SR & USART_TC) != 0;
    if (idle) {
        USART1->CR1 = 0;
        USART1->BRR = BAUD_DIVIDER(baud);
        USART1->CR1 = USART_UE | USART_RE | USART_TE;
    }
    return idle;
}
