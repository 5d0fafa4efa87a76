/* The STM32H743's clocks, converters and line: three ADCs with three, three and two sensors each, and two chips of four DACs
 * behind an SPI each (.github/decisions/0019-a-board-for-eight-modes.md). */
#include "chip.h"

#include <string.h>

#include "framed.h"
#include "setup.h"
#include "wait.h"

_Static_assert(HD_MODES == 8, "the STM32H743's image is for eight modes; fewer have the STM32F405 and the STM32G474");
_Static_assert(HD_SAMPLE_HZ == 320000 && PERIOD == DACS_OF_A_CHIP * PART, "a word each 781 ns");
_Static_assert(SYNC_HIGH + START + WORD < PART, "a word is through before the next");
_Static_assert(LINK_BAUD >= HD_BAUD_MIN && LINK_BAUD_MAX <= APB_HZ / 16, "USART3, 16 samples a bit");

#define BAUD_DIVIDER(baud) ((APB_HZ + (baud) / 2) / (baud))
#define REGULATOR_TURNS 1000 /* of at least 4 cycles: 10 us, what the ADCs' regulators need */
#define CALIBRATED_TURNS 100 /* 4 cycles of the ADC's clock, from the end of its calibration */
#define READY_TURNS 1000
#define WORDS (2 * HD_CHUNK * CHIP_MODES)
#define SERIAL_FUNCTION 7
#define FASTEST(pin) (3u << 2 * (pin))

/* The DACs' pins: SPI1 and SPI3, and the one SYNC of both chips, which TIM3 moves. */
#define FIRST_CLOCK 5   /* PA5, SCLK of the DACs of modes 0 to 3 */
#define FIRST_DATA 5    /* PB5, DIN of the DACs of modes 0 to 3 */
#define SECOND_CLOCK 10 /* PC10, SCLK of the DACs of modes 4 to 7 */
#define SECOND_DATA 12  /* PC12, DIN of the DACs of modes 4 to 7 */
#define SYNC_BOTH 6     /* PA6, SYNC of all DACs */
#define SPI1_FUNCTION 5
#define SPI3_FUNCTION 6
#define TIM3_FUNCTION 2

STREAMED static _Alignas(uint32_t) uint16_t sampled_1[2][HD_CHUNK][3], sampled_2[2][HD_CHUNK][3], sampled_3[2][HD_CHUNK][SENSORS_3];
STREAMED static words_t played_1[2], played_3[2];

bool chip_use_pll(void)
{
    SCB_ICIALLU = 0;
    __asm volatile("dsb\n\tisb" : : : "memory");
    SCB_CCR |= CCR_ICACHE; /* of the flash; no cache of data: nothing that the DMA moves is ever in one */
    __asm volatile("dsb\n\tisb" : : : "memory");
    MPU_RNR = 1; /* the core may read ahead where there is nothing */
    MPU_RBAR = 0;
    MPU_RASR = MPU_NO_EXTERNAL_MEMORY;
    RCC->GCR = GCR_WINDOW_WATCHDOG;
    PWR->CR3 = PWR_LDO;
    bool ready = reaches(&PWR->CSR1, PWR_ACTVOSRDY, PWR_ACTVOSRDY);
    PWR->D3CR = PWR_VOS1;
    ready = ready && reaches(&PWR->D3CR, PWR_VOSRDY, PWR_VOSRDY);
    FLASH->ACR = ACR_192_MHZ;
    RCC->D1CFGR = D1_HALF_OF_THE_CORE;
    RCC->D2CFGR = D2_APB_HALF;
    RCC->D3CFGR = D3_APB_HALF;
    if (!ready || !reaches(&FLASH->ACR, ACR_192_MHZ, ACR_192_MHZ)) {
        return false;
    }
    RCC->CFGR = CFGR_SW_PLL;
    return reaches(&RCC->CFGR, CFGR_SWS, CFGR_SW_PLL << 3);
}

bool chip_guards_brown_out(void)
{
    return (FLASH->OPTSR_CUR & OPTSR_BOR) == OPTSR_BOR_LEVEL_3;
}

bool chip_watch_supply(void)
{
    PWR->CR1 |= PWR_PLS_2V85 | PWR_PVDE;
    return reaches(&PWR->CSR1, PWR_PVDO, 0);
}

static void set(gpio_t *port, int pin, bool high)
{
    port->BSRR = high ? 1u << pin : 1u << (pin + 16);
}

/* By hand, to both chips at once: neither an SPI nor its clock has to work. */
static void send_to_both(uint32_t word)
{
    set(GPIOA, SYNC_BOTH, true); /* a word under way ends without effect */
    set(GPIOA, FIRST_CLOCK, false);
    set(GPIOC, SECOND_CLOCK, false);
    set(GPIOA, SYNC_BOTH, false);
    for (uint32_t bit = 1u << 23; bit != 0; bit >>= 1) {
        bool is_set = (word & bit) != 0;
        set(GPIOB, FIRST_DATA, is_set);
        set(GPIOC, SECOND_DATA, is_set);
        set(GPIOA, FIRST_CLOCK, true);
        set(GPIOC, SECOND_CLOCK, true);
        set(GPIOA, FIRST_CLOCK, false); /* the DAC reads now */
        set(GPIOC, SECOND_CLOCK, false);
    }
    set(GPIOA, SYNC_BOTH, true);
}

static void direct(gpio_t *port, uint32_t pins, uint32_t mode)
{
    port->MODER = (port->MODER & ~pins) | mode;
}

/* The ADCs' pins are analogue since the reset. */
void converters_silence(void)
{
    clock_on(&RCC->AHB2ENR, AHB2_SRAMS);
    TIM3->CR1 = 0;
    direct(GPIOA, ANALOGUE(FIRST_CLOCK) | ANALOGUE(SYNC_BOTH), OUTPUT(FIRST_CLOCK) | OUTPUT(SYNC_BOTH));
    direct(GPIOB, ANALOGUE(FIRST_DATA), OUTPUT(FIRST_DATA));
    direct(GPIOC, ANALOGUE(SECOND_CLOCK) | ANALOGUE(SECOND_DATA), OUTPUT(SECOND_CLOCK) | OUTPUT(SECOND_DATA));
    send_to_both(WORD_MOVE_ALL | WORD_MID_RAIL);
}

static void start_stream(dma_stream_t *stream, const volatile void *peripheral, void *memory, uint32_t items, uint32_t flags)
{
    stream->PAR = (uint32_t)(uintptr_t)peripheral;
    stream->M0AR = (uint32_t)(uintptr_t)memory;
    stream->NDTR = items;
    stream->FCR = 0; /* direct */
    stream->CR = DMA_MINC | DMA_CIRC | DMA_PRIORITY(3) | DMA_TEIE | flags;
    __asm volatile("dsb" : : : "memory"); /* what the stream will read is written */
    stream->CR |= DMA_EN;
}

static void give_pins_to_spis(void)
{
    GPIOA->OSPEEDR |= FASTEST(FIRST_CLOCK) | FASTEST(SYNC_BOTH);
    GPIOB->OSPEEDR |= FASTEST(FIRST_DATA);
    GPIOC->OSPEEDR |= FASTEST(SECOND_CLOCK) | FASTEST(SECOND_DATA);
    GPIOA->AFR[0] |= FUNCTION(FIRST_CLOCK, SPI1_FUNCTION) | FUNCTION(SYNC_BOTH, TIM3_FUNCTION);
    GPIOB->AFR[0] |= FUNCTION(FIRST_DATA, SPI1_FUNCTION);
    GPIOC->AFR[1] |= FUNCTION(SECOND_CLOCK, SPI3_FUNCTION) | FUNCTION(SECOND_DATA, SPI3_FUNCTION);
    direct(GPIOA, ANALOGUE(FIRST_CLOCK) | ANALOGUE(SYNC_BOTH), ALTERNATE(FIRST_CLOCK) | ALTERNATE(SYNC_BOTH));
    direct(GPIOB, ANALOGUE(FIRST_DATA), ALTERNATE(FIRST_DATA));
    direct(GPIOC, ANALOGUE(SECOND_CLOCK) | ANALOGUE(SECOND_DATA), ALTERNATE(SECOND_CLOCK) | ALTERNATE(SECOND_DATA));
}

static void start_spi(spi_t *spi)
{
    spi->CFG1 = SPI_24_BITS | SPI_DIV4;
    spi->CFG2 = SPI_MASTER_OUT;
    spi->CR1 = SPI_SSI;
    spi->CR1 = SPI_SSI | SPI_SPE;
    spi->CR1 = SPI_SSI | SPI_SPE | SPI_CSTART; /* without an end; it waits for words */
}

static void start_dacs(void)
{
    static const uint32_t silence[CHIP_MODES] = {WORD_STORE(0) | WORD_MID_RAIL, WORD_STORE(1) | WORD_MID_RAIL,
                                                 WORD_STORE(2) | WORD_MID_RAIL, WORD_STORE_4TH_AND_MOVE | WORD_MID_RAIL};
    for (int i = 0; i < 2 * HD_CHUNK; i++) {
        memcpy(played_1[i / HD_CHUNK][i % HD_CHUNK], silence, sizeof silence);
        memcpy(played_3[i / HD_CHUNK][i % HD_CHUNK], silence, sizeof silence);
    }
    DMAMUX[0] = REQUEST_TIM3_CH1;
    DMAMUX[1] = REQUEST_TIM3_CH3;
    start_stream(&DMA1->STREAM[0], &SPI1->TXDR, played_1, WORDS, DMA_WORDS | DMA_TO_PERIPHERAL);
    start_stream(&DMA1->STREAM[1], &SPI3->TXDR, played_3, WORDS, DMA_WORDS | DMA_TO_PERIPHERAL);
    TIM3->PSC = 0;
    TIM3->ARR = PART - 1;
    TIM3->CCR[0] = TIM3->CCR[2] = SYNC_HIGH;
    TIM3->CNT = 0;
    TIM3->CCMR[0] = TIM_OC1M_PWM1;
    TIM3->CCER = TIM_CC1E;
    TIM3->DIER = TIM_CC1DE | TIM_CC3DE;
    TIM3->SMCR = TIM_STARTED_BY_TIM2;
    start_spi(SPI1);
    start_spi(SPI3);
    give_pins_to_spis();
}

/* As long as it is not ready, as an enable within 4 cycles after the calibration is lost (RM0433, 25.4.9). */
static void enable(adc_t *adc)
{
    adc->ISR = ADC_ADRDY;
    for (int turn = 0; turn < READY_TURNS && (adc->ISR & ADC_ADRDY) == 0; turn++) {
        adc->CR = ADC_ADVREGEN | ADC_BOOST_25_MHZ | ADC_ADEN;
    }
}

static void wake_regulators(void)
{
    for (volatile int turn = 0; turn < REGULATOR_TURNS; turn++) {
    }
}

static void calibrate(adc_t *adc)
{
    adc->CR = ADC_ADVREGEN | ADC_BOOST_25_MHZ;
    adc->CR = ADC_ADVREGEN | ADC_BOOST_25_MHZ | ADC_ADCAL;
    (void)reaches(&adc->CR, ADC_ADCAL, 0);
    for (volatile int turn = 0; turn < CALIBRATED_TURNS; turn++) {
    }
}

static void start_adc(adc_t *adc, const uint8_t channels[], uint32_t n)
{
    calibrate(adc);
    adc->CFGR = ADC_JQDIS | ADC_DMA_CIRCULAR | ADC_12_BITS | ADC_EXTSEL_TIM2_TRGO | ADC_EXTEN_FALLING;
    uint32_t selected = 0, sequence = n - 1, sampling[2] = {0, 0};
    for (uint32_t rank = 0; rank < n; rank++) {
        selected |= 1u << channels[rank];
        sequence |= (uint32_t)channels[rank] << 6 * (rank + 1);
        sampling[channels[rank] / 10] |= ADC_SAMPLE_8_5(channels[rank]);
    }
    adc->PCSEL = selected;
    adc->SMPR[0] = sampling[0];
    adc->SMPR[1] = sampling[1];
    adc->SQR[0] = sequence;
    enable(adc);
    adc->CR = ADC_ADVREGEN | ADC_BOOST_25_MHZ | ADC_ADEN | ADC_ADSTART;
}

static const uint8_t sensors_1[] = {2, 6, 15};      /* PF11, PF12, PA3: modes 0 to 2 */
static const uint8_t sensors_2[] = {2, 5, 10};      /* PF13, PB1, PC0: modes 3 to 5 */
static const uint8_t sensors_3[SENSORS_3] = {4, 6}; /* PF5, PF10: modes 6 and 7 */

/* 24 MHz, 8.5 cycles to sample (0.35 us, out of some nF at the pin, as on the others) and 6.5 to convert: three take 1.9 us of the
 * 2.2 before the DACs move. */
static void start_adcs(void)
{
    ADC12_CCR = ADC3_CCR = ADC_CKMODE_DIV4;
    ADC1->CR = ADC2->CR = ADC3->CR = 0; /* out of deep power-down */
    ADC1->CR = ADC2->CR = ADC3->CR = ADC_ADVREGEN;
    wake_regulators();
    DMAMUX[8] = REQUEST_ADC3;
    DMAMUX[9] = REQUEST_ADC1;
    DMAMUX[10] = REQUEST_ADC2;
    start_stream(&DMA2->STREAM[0], &ADC3->DR, sampled_3, 2 * HD_CHUNK * SENSORS_3, DMA_HALFWORDS);
    start_stream(&DMA2->STREAM[1], &ADC1->DR, sampled_1, 2 * HD_CHUNK * 3, DMA_HALFWORDS);
    start_stream(&DMA2->STREAM[2], &ADC2->DR, sampled_2, 2 * HD_CHUNK * 3, DMA_HALFWORDS | DMA_HTIE | DMA_TCIE);
    start_adc(ADC1, sensors_1, sizeof sensors_1);
    start_adc(ADC2, sensors_2, sizeof sensors_2);
    start_adc(ADC3, sensors_3, sizeof sensors_3);
}

float reference_reading(void)
{
    ADC3->CR = ADC_ADVREGEN | ADC_BOOST_25_MHZ | ADC_ADEN | ADC_ADSTART;
    return reaches(&ADC3->ISR, ADC_EOC, ADC_EOC) ? (float)ADC3->DR : 0.0f; /* which clears the flag */
}

void reference_start(void)
{
    clock_on(&RCC->AHB4ENR, AHB4_ADC3);
    ADC3_CCR = ADC_CKMODE_DIV4 | ADC_VREFEN;
    ADC3->CR = 0; /* out of deep power-down */
    ADC3->CR = ADC_ADVREGEN;
    wake_regulators();
    calibrate(ADC3);
    ADC3->PCSEL = 1u << ADC_VREFINT;
    ADC3->SMPR[1] = ADC_SAMPLE_810_5;
    ADC3->SQR[0] = ADC_VREFINT << 6;
    enable(ADC3);
}

void reference_stop(void)
{
    RCC->AHB4RSTR = AHB4_ADC3; /* as it was */
    RCC->AHB4RSTR = 0;
}

void converters_start(void)
{
    clock_on(&RCC->AHB1ENR, AHB1_DMAS | AHB1_ADC12);
    clock_on(&RCC->AHB4ENR, AHB4_ADC3);
    clock_on(&RCC->APB1ENR, APB1_SPI3);
    clock_on(&RCC->APB2ENR, APB2_SPI1);
    DMA1->LIFCR = DMA_ALL | DMA_ALL << 6;
    DMA2->LIFCR = DMA_ALL | DMA_ALL << 6 | DMA_ALL << 16;
    start_dacs();
    start_adcs();
}

void converters_stop(void)
{
    for (int i = 0; i < 3; i++) {
        DMA2->STREAM[i].CR = 0;
        DMA1->STREAM[i].CR = 0; /* the third is not used */
    }
    for (int i = 0; i < 3; i++) {
        (void)reaches(&DMA2->STREAM[i].CR, DMA_EN, 0); /* the word under way is finished first */
        (void)reaches(&DMA1->STREAM[i].CR, DMA_EN, 0);
    }
    RCC->AHB1RSTR = AHB1_ADC12;
    RCC->AHB4RSTR = AHB4_ADC3;
    RCC->APB2RSTR = APB2_SPI1;
    RCC->APB1RSTR = APB1_SPI3 | APB1_TIM2 | APB1_TIM3;
    RCC->AHB1RSTR = RCC->AHB4RSTR = RCC->APB2RSTR = RCC->APB1RSTR = 0;
}

/* A stream of words is at most the one that waits in it and the four of a sample ahead of the samples. */
static bool in_step(const dma_stream_t *words, uint32_t samples)
{
    return (CHIP_MODES * samples - words->NDTR + WORDS) % WORDS <= 2 * CHIP_MODES;
}

bool converters_in_step(void)
{
    uint32_t samples = (DMA2->STREAM[2].NDTR + 2) / 3; /* to come, the one under way among them */
    bool lost = ((ADC1->ISR | ADC2->ISR | ADC3->ISR) & ADC_OVR) != 0 || (SPI1->SR & SPI3->SR & SPI_TXP) == 0;
    return !lost && in_step(&DMA1->STREAM[0], samples) && in_step(&DMA1->STREAM[1], samples);
}

bool converters_listen(hd_carrier_t *carrier, int half)
{
    _Alignas(uint32_t) sampled_t in; /* by words: each read of the DMA's memory takes as long as a dozen of the core's */
    memcpy(in.adc1, sampled_1[half], sizeof in.adc1);
    memcpy(in.adc2, sampled_2[half], sizeof in.adc2);
    memcpy(in.adc3, sampled_3[half], sizeof in.adc3);
    return framed_listen(carrier, &in);
}

void converters_speak(hd_carrier_t *carrier, int half)
{
    words_t *out[2] = {&played_1[half], &played_3[half]};
    framed_speak(carrier, out);
}

void serial_start(void)
{
    clock_on(&RCC->AHB1ENR, AHB1_DMAS);
    clock_on(&RCC->APB1ENR, APB1_USART3);
    GPIOD->PUPDR |= PULL_UP(9); /* an open input is a line at rest, not noise */
    GPIOD->AFR[1] |= FUNCTION(8, SERIAL_FUNCTION) | FUNCTION(9, SERIAL_FUNCTION);
    GPIOD->MODER = (GPIOD->MODER & ~(ANALOGUE(8) | ANALOGUE(9))) | ALTERNATE(8) | ALTERNATE(9);
    USART3->BRR = BAUD_DIVIDER(LINK_BAUD);
    USART3->CR3 = USART_DMAR | USART_DMAT | USART_OVRDIS; /* a byte that came too early is lost, and no more */
    USART3->CR1 = USART_UE | USART_RE | USART_TE;
    DMAMUX[11] = REQUEST_USART3_RX;
    DMAMUX[12] = REQUEST_USART3_TX;
}

bool serial_set_baud(uint32_t baud)
{
    bool idle = (USART3->ISR & USART_TC) != 0;
    if (idle) {
        USART3->CR1 = 0; /* its divider is locked while it is enabled */
        USART3->BRR = BAUD_DIVIDER(baud);
        USART3->CR1 = USART_UE | USART_RE | USART_TE;
    }
    return idle;
}
