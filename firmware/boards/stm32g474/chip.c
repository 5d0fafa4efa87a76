/* The STM32G474's clocks, converters and line. Every mode has an ADC, a DAC and two streams of its own. */
#include "chip.h"

#include "planar.h"
#include "setup.h"
#include "wait.h"

_Static_assert(HD_MODES >= 2 && HD_MODES <= 5, "five ADCs of the STM32G474, and as many of its DACs, have pins");
_Static_assert(CRYSTAL_HZ % 4000000 == 0 && CRYSTAL_HZ <= 48000000, "the PLL needs 4 MHz");
_Static_assert(LINK_BAUD >= 41504 && LINK_BAUD_MAX <= CORE_HZ / 3, "LPUART1 wants 3 to 4096 cycles a bit");

#define BAUD_DIVIDER(baud) ((uint32_t)(256.0f * (float)CORE_HZ / (float)(baud) + 0.5f)) /* in 1/256 of a cycle */
#define WORDS (2 * HD_CHUNK)
#define REGULATOR_TURNS 1000 /* of at least 4 cycles: 23 us, where the ADCs' regulators need 20 */
#define CALIBRATED_TURNS 20  /* 4 cycles of the ADC's clock, from the end of its calibration */
#define SERIAL_FUNCTION 12

typedef struct {
    adc_t *adc;
    uint8_t channel;
    uint8_t adc_request;
    uint8_t dac_request;
    reg_t *dac_data;
} lane_t;

static const lane_t lane[] = {
    {ADC1, 1, REQUEST_ADC1, REQUEST_DAC1_1, &DAC1->DHR12R1},  /* PA0; PA4 */
    {ADC2, 2, REQUEST_ADC2, REQUEST_DAC1_2, &DAC1->DHR12R2},  /* PA1; PA5 */
    {ADC3, 12, REQUEST_ADC3, REQUEST_DAC2_1, &DAC2->DHR12R1}, /* PB0; PA6 */
    {ADC4, 5, REQUEST_ADC4, REQUEST_DAC3_2, &DAC3->DHR12R2},  /* PB15; PB1 from OPAMP3 */
    {ADC5, 2, REQUEST_ADC5, REQUEST_DAC3_1, &DAC3->DHR12R1},  /* PA9; PB11 from OPAMP6 */
};

static _Alignas(uint32_t) uint16_t sampled[HD_MODES][2][HD_CHUNK];
static _Alignas(uint32_t) uint16_t played[HD_MODES][2][HD_CHUNK];

/* RM0440, 6.1.5: above 80 MHz by way of half of it, for a microsecond. */
bool chip_use_pll(void)
{
    RCC->APB1ENR |= APB1_PWR;
    (void)RCC->APB1ENR;
    PWR->CR5 &= ~PWR_R1MODE;
    FLASH->ACR = ACR_170_MHZ;
    if (!reaches(&FLASH->ACR, 0xF, ACR_170_MHZ & 0xF)) {
        return false;
    }
    RCC->CFGR |= CFGR_HPRE_DIV2;
    RCC->CFGR |= CFGR_SW_PLL;
    if (!reaches(&RCC->CFGR, CFGR_SWS, CFGR_SW_PLL << 2)) {
        return false;
    }
    for (volatile int turn = 0; turn < 50; turn++) {
    }
    RCC->CFGR &= ~CFGR_HPRE_DIV2;
    return true;
}

bool chip_guards_brown_out(void)
{
    return (FLASH->OPTR & OPTR_BOR) >= OPTR_BOR_LEVEL_4;
}

bool chip_watch_supply(void)
{
    PWR->CR2 |= PWR_PLS_2V9 | PWR_PVDE;
    return reaches(&PWR->SR2, PWR_PVDO, 0);
}

/* Modes 3 and 4: DAC3 has no pins, operational amplifiers follow it to theirs. */
static void silence_followers(void)
{
    RCC->APB2ENR |= APB2_SYSCFG; /* the amplifiers' clock too */
    (void)RCC->APB2ENR;
    DAC3->DHR12RD = HD_MID_RAIL << 16 | HD_MID_RAIL;
    DAC3->MCR = DAC_HFSEL_160_MHZ | DAC_WITHIN;
    DAC3->CR = DAC_BOTH(DAC_EN);
    OPAMP[3 - 1] = OPAMP_FOLLOWS_DAC;
    GPIOB->MODER |= ANALOGUE(1) | ANALOGUE(15);
    if (HD_MODES > 4) {
        OPAMP[6 - 1] = OPAMP_FOLLOWS_DAC;
        GPIOA->MODER |= ANALOGUE(9);
        GPIOB->MODER |= ANALOGUE(11);
    }
}

void converters_silence(void)
{
    RCC->AHB2ENR |= AHB2_DACS;
    (void)RCC->AHB2ENR;
    DAC1->DHR12RD = HD_MID_RAIL << 16 | HD_MID_RAIL;
    DAC2->DHR12R1 = HD_MID_RAIL;
    DAC1->MCR = DAC2->MCR = DAC_HFSEL_160_MHZ;
    DAC1->CR = DAC_BOTH(DAC_EN); /* no trigger: what was written is put out within a few cycles */
    DAC2->CR = DAC_EN;
    GPIOA->MODER |= ANALOGUE(0) | ANALOGUE(1) | ANALOGUE(4) | ANALOGUE(5) | ANALOGUE(6);
    GPIOB->MODER |= ANALOGUE(0);
    if (HD_MODES > 3) {
        silence_followers();
    }
}

static void start_stream(dma_stream_t *stream, const volatile void *peripheral, void *memory, uint32_t flags)
{
    stream->PAR = (uint32_t)(uintptr_t)peripheral;
    stream->M0AR = (uint32_t)(uintptr_t)memory;
    stream->NDTR = WORDS;
    stream->CR = DMA_HALFWORDS | DMA_MINC | DMA_CIRC | DMA_PRIORITY(3) | DMA_TEIE | flags;
    __asm volatile("dsb" : : : "memory"); /* what the stream will read is written */
    stream->CR |= DMA_EN;
}

static void start_dacs(void)
{
    for (int k = 0; k < HD_MODES; k++) {
        for (int i = 0; i < WORDS; i++) {
            played[k][i / HD_CHUNK][i % HD_CHUNK] = HD_MID_RAIL;
        }
        DMAMUX[8 + k] = lane[k].dac_request;
        start_stream(&DMA2->STREAM[k], lane[k].dac_data, played[k], DMA_TO_PERIPHERAL);
    }
    DAC1->CR = DAC_BOTH(DAC_EN | DAC_TEN | DAC_TSEL_TIM2 | DAC_DMAEN);
    if (HD_MODES > 2) {
        DAC2->CR = DAC_EN | DAC_TEN | DAC_TSEL_TIM2 | DAC_DMAEN;
    }
    if (HD_MODES > 3) {
        uint32_t second = (DAC_EN | DAC_TEN | DAC_TSEL_TIM2 | DAC_DMAEN) << 16;
        DAC3->CR = HD_MODES > 4 ? second | second >> 16 : second;
    }
}

static void calibrate(adc_t *adc)
{
    adc->CR = ADC_ADVREGEN | ADC_ADCAL;
    (void)reaches(&adc->CR, ADC_ADCAL, 0);
    for (volatile int turn = 0; turn < CALIBRATED_TURNS; turn++) {
    }
}

static void enable(adc_t *adc)
{
    adc->ISR = ADC_ADRDY;
    adc->CR = ADC_ADVREGEN | ADC_ADEN;
    (void)reaches(&adc->ISR, ADC_ADRDY, ADC_ADRDY);
}

static void start_adc(adc_t *adc, uint32_t channel)
{
    calibrate(adc);
    adc->CFGR = ADC_DMA_CIRCULAR | ADC_EXTSEL_TIM2_TRGO | ADC_EXTEN_FALLING;
    adc->SMPR[channel / 10] = ADC_SAMPLE_6_5(channel);
    adc->SQR[0] = ADC_SEQUENCE(channel);
    enable(adc);
    adc->CR = ADC_ADVREGEN | ADC_ADEN | ADC_ADSTART;
}

static void prepare_reference(adc_t *adc)
{
    adc->CR = 0; /* out of deep power-down */
    adc->CR = ADC_ADVREGEN;
    for (volatile int turn = 0; turn < REFERENCE_TURNS; turn++) {
    }
    calibrate(adc);
    adc->SMPR[1] = ADC_SAMPLE_640_5;
    adc->SQR[0] = ADC_SEQUENCE(ADC_VREFINT);
    enable(adc);
}

/* 42.5 MHz, 6.5 cycles to sample and 12.5 to convert: 0.45 us, over before the DACs move again. 0.15 us are as short as on the
 * STM32F405: a capacitor of some nF at the pin has to hold the sample, and what does not settle is a constant gain. */
static void start_adcs(void)
{
    ADC12_CCR = ADC_CKMODE_DIV4;
    ADC345_CCR = ADC_CKMODE_DIV4 | (REFERENCE_IS_WATCHED ? ADC_VREFEN : 0u);
    for (int k = 0; k < HD_MODES; k++) {
        lane[k].adc->CR = 0; /* out of deep power-down */
        lane[k].adc->CR = ADC_ADVREGEN;
    }
    for (volatile int turn = 0; turn < REGULATOR_TURNS; turn++) {
    }
    for (int k = 0; k < HD_MODES; k++) {
        uint32_t interrupts = k == CHUNK_STREAM ? DMA_HTIE | DMA_TCIE : 0;
        DMAMUX[k] = lane[k].adc_request;
        start_stream(&DMA1->STREAM[k], &lane[k].adc->DR, sampled[k], interrupts);
        start_adc(lane[k].adc, lane[k].channel);
    }
    /* One reading after the other, by software: an interrupt that comes to it late loses nothing. A reading more than 1 ms after
     * the last may be wrong (ES0430, 2.7.7): ticks ask each 0.5 ms at least. It is out of step with the sensors' ADCs, which may
     * disturb them (2.7.11, in rev 8 2.7.9). */
    if (REFERENCE_IS_WATCHED) {
        prepare_reference(ADC5);
        ADC5->CR = ADC_ADVREGEN | ADC_ADEN | ADC_ADSTART;
    }
}

uint32_t reference_glance(void)
{
    if ((ADC5->ISR & ADC_EOC) == 0) {
        return 0;
    }
    uint32_t reading = ADC5->DR; /* which clears the flag */
    ADC5->CR = ADC_ADVREGEN | ADC_ADEN | ADC_ADSTART;
    return reading;
}

float reference_reading(void)
{
    ADC1->CR = ADC_ADVREGEN | ADC_ADEN | ADC_ADSTART;
    return reaches(&ADC1->ISR, ADC_EOC, ADC_EOC) ? (float)ADC1->DR : 0.0f; /* which clears the flag */
}

void reference_start(void)
{
    RCC->AHB2ENR |= AHB2_ADCS;
    (void)RCC->AHB2ENR;
    ADC12_CCR = ADC_CKMODE_DIV4 | ADC_VREFEN;
    prepare_reference(ADC1);
}

void reference_stop(void)
{
    RCC->AHB2RSTR = AHB2_ADCS; /* as they were */
    RCC->AHB2RSTR = 0;
}

void converters_start(void)
{
    RCC->AHB1ENR |= AHB1_DMAS;
    RCC->AHB2ENR |= AHB2_ADCS;
    (void)RCC->AHB2ENR;
    DMA1->IFCR = DMA2->IFCR = (1u << 4 * HD_MODES) - 1u;
    start_dacs();
    start_adcs();
}

void converters_stop(void)
{
    for (int k = 0; k < HD_MODES; k++) {
        DMA1->STREAM[k].CR = DMA2->STREAM[k].CR = 0;
    }
    RCC->AHB2RSTR = AHB2_ADCS | AHB2_DACS;
    RCC->APB1RSTR = APB1_TIM2;
    RCC->AHB2RSTR = 0;
    RCC->APB1RSTR = 0;
}

/* The DACs' streams are one or two words ahead: they have fetched what the next trigger will put out. */
bool converters_in_step(void)
{
    uint32_t lost = (DAC1->SR | DAC2->SR | (HD_MODES > 3 ? DAC3->SR : 0u)) & DAC_UNDERRUNS;
    for (int k = 0; k < HD_MODES; k++) {
        uint32_t lead = (DMA1->STREAM[k].NDTR - DMA2->STREAM[k].NDTR + WORDS) % WORDS;
        lost |= (lane[k].adc->ISR & ADC_OVR) | (lead > 2);
    }
    return lost == 0;
}

bool converters_listen(hd_carrier_t *carrier, int half)
{
    return planar_listen(carrier, sampled[0][half]);
}

void converters_speak(hd_carrier_t *carrier, int half)
{
    planar_speak(carrier, played[0][half]);
}

void serial_start(void)
{
    RCC->AHB1ENR |= AHB1_DMAS;
    RCC->APB1ENR2 |= APB1_LPUART1;
    (void)RCC->APB1ENR2;
    GPIOA->PUPDR |= PULL_UP(3); /* an open input is a line at rest, not noise */
    GPIOA->AFR[0] |= FUNCTION(2, SERIAL_FUNCTION) | FUNCTION(3, SERIAL_FUNCTION);
    GPIOA->MODER = (GPIOA->MODER & ~(ANALOGUE(2) | ANALOGUE(3))) | ALTERNATE(2) | ALTERNATE(3);
    LPUART1->BRR = BAUD_DIVIDER(LINK_BAUD);
    LPUART1->CR3 = USART_DMAR | USART_DMAT | USART_OVRDIS; /* a byte that came too early is lost, and no more */
    LPUART1->CR1 = USART_UE | USART_RE | USART_TE;
    DMAMUX[6] = REQUEST_LPUART1_RX;
    DMAMUX[7] = REQUEST_LPUART1_TX;
}

bool serial_set_baud(uint32_t baud)
{
    bool idle = (LPUART1->ISR & USART_TC) != 0;
    if (idle) {
        LPUART1->CR1 = 0; /* its divider is locked while it is enabled */
        LPUART1->BRR = BAUD_DIVIDER(baud);
        LPUART1->CR1 = USART_UE | USART_RE | USART_TE;
    }
    return idle;
}
