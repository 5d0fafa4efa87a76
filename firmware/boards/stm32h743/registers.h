/* The registers that the STM32H743 has in its own way, revision V: RM0433 by chapters (flash, PWR, RCC, SYSCFG, DMA, DMAMUX, NVIC,
 * EXTI, ADC, timers, IWDG, WWDG, USART, SPI, DBGMCU), pins after DS12110. Checked against the public CMSIS header of the
 * chip and two independent ones (libopencm3, NuttX), not against silicon. */
#ifndef HD_H743_REGISTERS_H
#define HD_H743_REGISTERS_H

#include "f4_h7.h"

#define CRYSTAL_HZ 8000000 /* the ST-LINK's clock at OSC_IN (UM2407): CLOCK_AT_OSC_IN */
#define INTERNAL_HZ 64000000
#define CLOCK_AT_OSC_IN true
#define CORE_HZ 384000000
#define BUS_HZ 192000000  /* AXI and AHB */
#define TIMER_HZ 192000000 /* twice APB1 */
#define APB_HZ 96000000

/* APB1: the low word */
typedef struct {
    reg_t CR, HSICFGR, CRRCR, CSICFGR, CFGR, _0, D1CFGR, D2CFGR, D3CFGR, _1, PLLCKSELR, PLLCFGR, PLL1DIVR, PLL1FRACR, PLLS[4], _2,
        D1CCIPR, D2CCIP1R, D2CCIP2R, D3CCIPR, _3, CIER, CIFR, CICR, _4, BDCR, CSR, _5, AHB3RSTR, AHB1RSTR, AHB2RSTR, AHB4RSTR,
        APB3RSTR, APB1RSTR, APB1HRSTR, APB2RSTR, APB4RSTR, GCR, _6, D3AMR, _7[9], RSR, AHB3ENR, AHB1ENR, AHB2ENR, AHB4ENR, APB3ENR,
        APB1ENR, APB1HENR, APB2ENR, APB4ENR;
} rcc_t;

typedef struct {
    reg_t ACR, KEYR1, OPTKEYR, CR1, SR1, CCR1, OPTCR, OPTSR_CUR;
} flash_t;

typedef struct {
    reg_t CR1, CSR1, CR2, CR3, CPUCR, _0, D3CR;
} power_t;

typedef struct {
    reg_t _0, PMCR, EXTICR[4];
} syscfg_t;

typedef struct {
    reg_t RTSR, FTSR, SWIER, _0[29], IMR, EMR, PR;
} exti_t;

typedef struct {
    reg_t ISR, IER, CR, CFGR, CFGR2, SMPR[2], PCSEL, _0[4], SQR[4], DR;
} adc_t;

typedef struct {
    reg_t CR1, CR2, CR3, BRR, GTPR, RTOR, RQR, ISR, ICR, RDR, TDR, PRESC;
} usart_t;

typedef struct {
    reg_t CR1, CR2, CFG1, CFG2, IER, SR, IFCR, _0, TXDR;
} spi_t;

#define TIM3 ((timer_t *)0x40000400)
#define SPI3 ((spi_t *)0x40003C00)
#define USART3 ((usart_t *)0x40004800)
#define SPI1 ((spi_t *)0x40013000)
#define DMA1 ((dma_t *)0x40020000)
#define DMA2 ((dma_t *)0x40020400)
#define DMAMUX ((reg_t *)0x40020800) /* 0 to 7 for DMA1, 8 to 15 for DMA2 */
#define ADC1 ((adc_t *)0x40022000)
#define ADC2 ((adc_t *)0x40022100)
#define ADC12_CCR (*(reg_t *)0x40022308)
#define WWDG ((window_watchdog_t *)0x50003000)
#define FLASH ((flash_t *)0x52002000)
#define EXTI ((exti_t *)0x58000000)
#define SYSCFG ((syscfg_t *)0x58000400)
#define IWDG ((watchdog_t *)0x58004800)
#define GPIOA ((gpio_t *)0x58020000)
#define GPIOB ((gpio_t *)0x58020400)
#define GPIOC ((gpio_t *)0x58020800)
#define GPIOD ((gpio_t *)0x58020C00)
#define GPIOF ((gpio_t *)0x58021400)
#define RCC ((rcc_t *)0x58024400)
#define PWR ((power_t *)0x58024800)
#define CRC ((crc_t *)0x58024C00)
#define ADC3 ((adc_t *)0x58026000)
#define ADC3_CCR (*(reg_t *)0x58026308)
#define DBGMCU_IDCODE (*(const reg_t *)0x5C001000)
#define DBGMCU_APB3_FZ (*(reg_t *)0x5C001034)
#define DBGMCU_APB1_FZ (*(reg_t *)0x5C00103C)
#define DBGMCU_APB4_FZ (*(reg_t *)0x5C001054)
#define SCB_CCR (*(reg_t *)0xE000ED14)
#define SCB_ICIALLU (*(reg_t *)0xE000EF50)
#define UNIQUE_ID ((const reg_t *)0x1FF1E800) /* 96 bits */
#define VREFINT_CALIBRATION (*(const volatile uint16_t *)0x1FF1E860) /* DS12110, embedded reference: at 3.3 V, 30 C, 16 bits */
#define VREFINT_CALIBRATED_V 3.3f
#define REFERENCE_IS_WATCHED 0 /* the one ADC that reaches it has no time between its sensors' samples */

/* RCC. 8 MHz to the VCO, at 768: P for the core, Q for the SPIs. A `config` is what PLLCKSELR wants. */
#define PLL_CONFIG(input_hz, source) (((uint32_t)(input_hz) / 8000000) << 4 | (source))
#define PLL_CRYSTAL 2u
#define PLL_INTERNAL 0u
#define PLL_DIVIDERS ((96u - 1u) | (2u - 1u) << 9 | (4u - 1u) << 16)
#define PLL_WIDE_FROM_8_MHZ (3u << 2 | 1u << 16 | 1u << 17) /* the outputs P and Q of PLL1, and no others */
#define SET_PLL(config) \
    (RCC->PLLCKSELR = (config), RCC->PLL1DIVR = PLL_DIVIDERS, RCC->PLLCFGR = PLL_WIDE_FROM_8_MHZ)
#define CFGR_SW_PLL 3u
#define CFGR_SWS (7u << 3)
#define D1_HALF_OF_THE_CORE (8u << 0 | 4u << 4) /* AXI and AHB; half of that for APB3 */
#define D2_APB_HALF (4u << 4 | 4u << 8)
#define D3_APB_HALF (4u << 4)
#define GCR_WINDOW_WATCHDOG (1u << 0) /* resets the whole chip */
#define GPIO_ENR RCC->AHB4ENR
#define GPIO_PORTS (GPIO_A | GPIO_B | GPIO_C | 1u << 3 | 1u << 5)
#define AHB1_DMAS (1u << 0 | 1u << 1)
#define AHB1_ADC12 (1u << 5)
#define AHB2_SRAMS (1u << 29 | 1u << 30)
#define AHB4_ADC3 (1u << 24)
#define APB1_TIM3 (1u << 1)
#define APB1_SPI3 (1u << 15)
#define APB1_USART3 (1u << 18)
#define APB1_DAC APB1_TIM3 /* it times the words to them */
#define APB2_SPI1 (1u << 12)
#define CRC_CLOCK &RCC->AHB4ENR, 1u << 19
#define PWR_CLOCK &RCC->AHB4ENR, 0u /* always */
#define WWDG_CLOCK &RCC->APB3ENR, 1u << 6
#define SYSCFG_CLOCK &RCC->APB4ENR, 1u << 1
#define RESET_FLAGS RCC->RSR
#define CSR_RMVF (1u << 16)
#define CSR_BROWN_OUT (1u << 21)
#define CSR_PINRSTF (1u << 22)
#define CSR_POWER_UP (1u << 23)
#define CSR_SFTRSTF (1u << 24)
#define CSR_IWDGRSTF (1u << 26)
#define CSR_WWDGRSTF (1u << 28)
#define CSR_LPWRRSTF (1u << 30)

#define WWDG_UNIT (1u << 11 | 0x7Fu) /* no window; 96 MHz / 4096 / 2: 85.3 us */

#define ACR_192_MHZ 0x23u /* 3 wait states, WRHIGHFREQ 2: one more than VOS1 asks for */
#define OPTSR_BOR (3u << 2)
#define OPTSR_BOR_LEVEL_3 (3u << 2) /* 2.7 V */
#define PWR_LDO (1u << 1)           /* of CR3, to be written once */
#define PWR_ACTVOSRDY (1u << 13)    /* of CSR1 */
#define PWR_VOS1 (3u << 14)         /* of D3CR */
#define PWR_VOSRDY (1u << 13)
#define PWR_PLS_2V85 (6u << 5)      /* of CR1 */
#define PWR_PVDE (1u << 4)
#define PWR_PVDO (1u << 4)          /* of CSR1 */
#define CCR_ICACHE (1u << 17)
#define MPU_NO_EXTERNAL_MEMORY (1u << 28 | 0x87u << 8 | 31u << 1 | 1u) /* 0x60000000 to 0xDFFFFFFF: no access */

/* A halted core stops TIM2 and TIM3, and not IWDG, WWDG or any other. */
#define STOP_SAMPLES_ON_HALT (DBGMCU_APB1_FZ = 1u << 0 | 1u << 1, DBGMCU_APB3_FZ = 0, DBGMCU_APB4_FZ = 0)

/* DMA */
#define DMA_HALFWORDS (1u << 11 | 1u << 13) /* PSIZE, MSIZE */
#define DMA_TRBUFF (1u << 20) /* ES0392, 2.20.4: without it a stream of a USART may lock */

enum { REQUEST_ADC1 = 9, REQUEST_ADC2, REQUEST_TIM3_CH1 = 23, REQUEST_TIM3_CH3 = 25, REQUEST_USART3_RX = 45, REQUEST_USART3_TX,
       REQUEST_ADC3 = 115 };

/* ADC. HCLK / 4, which revision V halves: 24 MHz. */
#define ADC_ADRDY (1u << 0)
#define ADC_EOC (1u << 2)
#define ADC_OVR (1u << 4)
#define ADC_ADEN (1u << 0)
#define ADC_ADSTART (1u << 2)
#define ADC_BOOST_25_MHZ (2u << 8) /* 12.5 to 25 MHz, of revision V */
#define ADC_ADVREGEN (1u << 28)
#define ADC_ADCAL (1u << 31)
#define ADC_DMA_CIRCULAR (3u << 0)
#define ADC_12_BITS (2u << 2)
#define ADC_EXTSEL_TIM2_TRGO (11u << 5)
#define ADC_EXTEN_FALLING (2u << 10)
#define ADC_JQDIS (1u << 31)
#define ADC_CKMODE_DIV4 (3u << 16)
#define ADC_VREFEN (1u << 22)       /* of CCR */
#define ADC_VREFINT 19              /* of ADC3 */
#define ADC_SAMPLE_810_5 (7u << 27) /* of that channel: 34 us, where it needs 4.3 (DS12110) */
#define ADC_SAMPLE_8_5(channel) (2u << 3 * ((channel) % 10))
#define ADC_HZ 24000000.0f
#define ADC_SAMPLING 8.5f   /* cycles */
#define ADC_CONVERSION 15.0f /* with it */

/* SPI: 24 bits at 48 MHz, a quarter of PLL1's Q, on clocks whose falling edge the DAC reads at. NSS is not used. */
#define SPI_SPE (1u << 0)
#define SPI_CSTART (1u << 9)
#define SPI_SSI (1u << 12)
#define SPI_24_BITS 23u
#define SPI_DIV4 (1u << 28)
#define SPI_MASTER_OUT (1u << 22 | 1u << 26 | 1u << 17 | 1u << 24 | 1u << 31)
    /* of CFG2: master, SSM, to send alone, CPHA, and the pins are the SPI's while it is off too */
#define SPI_TXP (1u << 1) /* of SR: its FIFO has room */

/* TIM3 divides TIM2's period by the DACs of a chip. Each part begins with SYNC high; as it falls, a word goes to either SPI. */
#define TIM_CC1E (1u << 0)
#define TIM_CC1DE (1u << 9)
#define TIM_CC3DE (1u << 11)
#define TIM_STARTED_BY_TIM2 (1u << 4 | 6u << 0) /* of SMCR: ITR1; the trigger starts the counter */
#define DACS_OF_A_CHIP 4
#define PART (PERIOD / DACS_OF_A_CHIP) /* ticks of 5.2 ns: 781 ns */
#define SYNC_HIGH 10
#define WORD 96  /* 24 bits at 48 MHz */
#define START 25 /* from a request to the first clock: DMA, buses, SPI; in no manual, assumed */

/* The last word of a sample moves all DACs. Each ADC converts its sensors one after the other, through before that. */
#define SAMPLES_AT (PERIOD / 4)
#define RANK(mode) ((mode) % 3) /* of 0, 1, 2 on ADC1; 3, 4, 5 on ADC2; 6, 7 on ADC3 */
#define MOVED_S ((3.0f * PART + SYNC_HIGH + START + WORD) / (float)TIMER_HZ)
#define SAMPLED_S(mode) ((float)SAMPLES_AT / (float)TIMER_HZ + (ADC_SAMPLING + ADC_CONVERSION * RANK(mode)) / ADC_HZ)
#define CONVERTER_LAG_S(mode) (MOVED_S - SAMPLED_S(mode) + 0.5f / (float)HD_SAMPLE_HZ)

/* DMA2's streams 0 to 2 are those of ADC3, ADC1 and ADC2; requests are equally urgent and served in their order, so that
 * ADC2's last word is the last of its instant. DMA1's streams 0 and 1 are the SPIs'. */
#define CHUNK_FLAGS DMA2->LISR
#define CHUNK_CLEAR DMA2->LIFCR
#define CHUNK_ERROR (0x0Cu << 16) /* of the transfer, and of direct mode */
#define CHUNK_HALF (0x10u << 16)
#define CHUNK_COMPLETE (0x20u << 16)
#define IRQ_CHUNK 58
#define IRQS_TRANSFER_ERROR 11, 12, 56, 57
#define VECTORS_TRANSFER_ERROR(handler) [16 + 11 ... 16 + 12] = handler, [16 + 56 ... 16 + 57] = handler,
#define IRQ_LAST 58
#define TICK_CHUNKS_LATE 2 /* through in time even if each word beyond the buses takes 40 cycles (tests/firmware/test_m4_budget.py) */
#define STREAMED __attribute__((section(".streamed")))

#define INTERLOCK_PORT GPIOC
#define INTERLOCK_EXTICR EXTICR_PORT_C
#define IRQ_INTERLOCK IRQ_EXTI_5_TO_9
#define AMPLIFIER_FAULT 6 /* PC6, closed to ground; open: amplifier fault */
#define EMERGENCY_STOP 7  /* PC7, closed to ground; open: stop */

#define LINK_RX (&DMA2->STREAM[3])
#define LINK_RX_ROUTE DMA_TRBUFF
#define LINK_RX_DATA ((uint32_t)(uintptr_t)&USART3->RDR)
#define LINK_RX_CLEAR DMA2->LIFCR
#define LINK_RX_FLAGS (DMA_ALL << 22)
#define LINK_RX_RECOVER ((void)0) /* with OVRDIS there is no overrun */
#define LINK_TX (&DMA2->STREAM[4])
#define LINK_TX_ROUTE DMA_TRBUFF
#define LINK_TX_DATA ((uint32_t)(uintptr_t)&USART3->TDR)
#define LINK_TX_CLEAR DMA2->HIFCR
#define LINK_TX_FLAGS DMA_ALL
#define LINK_TX_DONE false /* the stream disables itself */

#define USART_TC (1u << 6)
#define USART_UE (1u << 0)
#define USART_OVRDIS (1u << 12)

#endif
