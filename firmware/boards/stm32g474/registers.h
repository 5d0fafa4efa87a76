/* The registers that the STM32G474 has in its own way, and what of it drives how many modes. RM0440 rev 9, by chapters: 3 flash
 * (its cache, DBANK), 7 RCC, 10 SYSCFG, 12 DMA, 13 DMAMUX (request inputs), 14 NVIC, 15 EXTI, 21 ADC (external triggers), 22
 * DAC (triggers, modes), 25 OPAMP; pins after DS12288. */
#ifndef HD_G474_REGISTERS_H
#define HD_G474_REGISTERS_H

#include "f4_g4.h"

#define CRYSTAL_HZ 24000000
#define CORE_HZ 170000000
#define TIMER_HZ CORE_HZ

typedef struct {
    reg_t CR, ICSCR, CFGR, PLLCFGR, _0[2], CIER, CIFR, CICR, _1, AHB1RSTR, AHB2RSTR, AHB3RSTR, _2, APB1RSTR, APB1RSTR2,
        APB2RSTR, _3, AHB1ENR, AHB2ENR, AHB3ENR, _4, APB1ENR, APB1ENR2, APB2ENR, _5, SMENR[8], CCIPR, _6, BDCR, CSR;
} rcc_t;

typedef struct {
    reg_t ACR, PDKEYR, KEYR, OPTKEYR, SR, CR, ECCR, _0, OPTR;
} flash_t;

typedef struct {
    reg_t CR1, CR2, CR3, CR4, SR1, SR2, SCR, _0, PULLS[24], CR5;
} power_t;

typedef struct {
    reg_t ISR, IER, CR, CFGR, CFGR2, SMPR[2], _0, TR[3], _1, SQR[4], DR;
} adc_t;

typedef struct {
    reg_t CR, NDTR, PAR, M0AR, _0;
} dma_stream_t; /* a "channel" there */

typedef struct {
    reg_t ISR, IFCR;
    dma_stream_t STREAM[8];
} dma_t;

typedef struct {
    reg_t CR1, CR2, CR3, BRR, GTPR, RTOR, RQR, ISR, ICR, RDR, TDR, PRESC;
} usart_t;

#define RCC ((rcc_t *)0x40021000)
#define FLASH ((flash_t *)0x40022000)
#define GPIOA ((gpio_t *)0x48000000)
#define GPIOB ((gpio_t *)0x48000400)
#define GPIOC ((gpio_t *)0x48000800)
#define PWR ((power_t *)0x40007000)
#define LPUART1 ((usart_t *)0x40008000)
#define SYSCFG ((syscfg_t *)0x40010000)
#define OPAMP ((reg_t *)0x40010300) /* the control registers of 1 to 6 */
#define EXTI ((exti_t *)0x40010400)
#define DMA1 ((dma_t *)0x40020000)
#define DMA2 ((dma_t *)0x40020400)
#define DMAMUX ((reg_t *)0x40020800) /* 0 to 7 for DMA1, 8 to 15 for DMA2 */
#define ADC1 ((adc_t *)0x50000000)
#define ADC2 ((adc_t *)0x50000100)
#define ADC12_CCR (*(reg_t *)0x50000308)
#define ADC3 ((adc_t *)0x50000400)
#define ADC4 ((adc_t *)0x50000500)
#define ADC5 ((adc_t *)0x50000600)
#define ADC345_CCR (*(reg_t *)0x50000708)
#define DAC1 ((dac_t *)0x50000800)
#define DAC2 ((dac_t *)0x50000C00)
#define DAC3 ((dac_t *)0x50001000)
#define UNIQUE_ID ((const reg_t *)0x1FFF7590) /* 96 bits */
#define VREFINT_CALIBRATION (*(const volatile uint16_t *)0x1FFF75AA) /* DS12288, embedded voltage reference: at 3.0 V, 30 C */
#define VREFINT_CALIBRATED_V 3.0f
#define REFERENCE_IS_WATCHED (HD_MODES < 5) /* ADC5 has no sensor */

/* RCC. VCO at 340 MHz from 4 MHz: 170 for the core. */
#define PLL_CONFIG(input_hz, source) (((uint32_t)(input_hz) / 4000000 - 1) << 4 | 85u << 8 | 1u << 24 | (source))
#define PLL_CRYSTAL 3u
#define PLL_INTERNAL 2u
#define CFGR_SW_PLL 3u
#define CFGR_HPRE_DIV2 (8u << 4)
#define GPIO_ENR RCC->AHB2ENR
#define AHB1_DMAS (1u << 0 | 1u << 1 | 1u << 2) /* both, and their multiplexer */
#define AHB2_ADCS (1u << 13 | 1u << 14)
#define AHB2_DACS (1u << 16 | 1u << 17 | (HD_MODES > 3 ? 1u << 18 : 0u))
#define APB1_DAC 0u
#define APB1_LPUART1 (1u << 0) /* of APB1ENR2 */
#define APB2_SYSCFG (1u << 0)
#define CSR_RMVF (1u << 23)
#define CSR_BROWN_OUT 0u

#define WWDG_UNIT (2u << 11 | 0x7Fu) /* no window; 170 MHz / 4096 / 4: 96.4 us */

#define ACR_170_MHZ 0x40704u /* 4 wait states; prefetch, instruction and data cache; debug as after a reset */
#define OPTR_BOR (7u << 8)
#define OPTR_BOR_LEVEL_4 (4u << 8) /* 2.8 V */
#define PWR_PVDE (1u << 0)      /* of CR2 */
#define PWR_PLS_2V9 (6u << 1)
#define PWR_PVDO (1u << 11)     /* of SR2 */
#define PWR_R1MODE (1u << 8)    /* of CR5; 0 is the boost mode, above 150 MHz */

/* DAC */
#define DAC_TEN (1u << 1)
#define DAC_TSEL_TIM2 (4u << 2)
#define DAC_BOTH(bits) ((bits) | (bits) << 16)
#define DAC_HFSEL_160_MHZ (2u << 14) /* of MCR, whose zeros are: to the pin, with the buffer */
#define DAC_WITHIN DAC_BOTH(3u)       /* of MCR: to what is on the chip, without the buffer */

/* OPAMP: RM0440, 25.5. Follower, high speed (45 V/us), from the DAC that is its VP_SEL 3, to its pin. */
#define OPAMP_FOLLOWS_DAC (1u << 0 | 3u << 2 | 3u << 5 | 1u << 7)

/* ADC */
#define ADC_ADRDY (1u << 0)
#define ADC_EOC (1u << 2)
#define ADC_VREFEN (1u << 22)     /* of CCR */
#define ADC_VREFINT 18            /* of ADC1, ADC3, ADC4 and ADC5: RM0440, 21.4.11 */
#define ADC_SAMPLE_640_5 (7u << 24) /* of that channel: 15 us at 42.5 MHz, where it needs 4 (DS12288) */
#define ADC_OVR (1u << 4)
#define ADC_ADEN (1u << 0)
#define ADC_ADSTART (1u << 2)
#define ADC_ADVREGEN (1u << 28)
#define ADC_ADCAL (1u << 31)
#define ADC_DMA_CIRCULAR (3u << 0)
#define ADC_EXTSEL_TIM2_TRGO (11u << 5)
#define ADC_EXTEN_FALLING (2u << 10)
#define ADC_CKMODE_DIV4 (3u << 16)
#define ADC_SAMPLE_6_5(channel) (1u << 3 * ((channel) % 10))
#define ADC_SEQUENCE(channel) ((uint32_t)(channel) << 6)

/* DMA */
#define DMA_EN (1u << 0)
#define DMA_TCIE (1u << 1)
#define DMA_HTIE (1u << 2)
#define DMA_TEIE (1u << 3)
#define DMA_TO_PERIPHERAL (1u << 4)
#define DMA_CIRC (1u << 5)
#define DMA_MINC (1u << 7)
#define DMA_HALFWORDS (2u << 8 | 1u << 10) /* a word at the peripheral, half of one in memory; 0 is bytes */
#define DMA_PRIORITY(p) ((uint32_t)(p) << 12)
#define DMA_ALL 0xFu

/* Streams 0 to 4 of DMA1 are the ADCs', of DMA2 the DACs'. Requests are equally urgent and served in their order, so
 * that the last mode's word is the last of its instant. */
#define CHUNK_STREAM (HD_MODES - 1)
#define CHUNK_FLAGS DMA1->ISR
#define CHUNK_CLEAR DMA1->IFCR
#define CHUNK_COMPLETE (2u << 4 * CHUNK_STREAM)
#define CHUNK_HALF (4u << 4 * CHUNK_STREAM)
#define CHUNK_ERROR (8u << 4 * CHUNK_STREAM)
#define IRQ_ADC_STREAM 11 /* of the first; so many follow */
#define IRQ_DAC_STREAM 56
#define IRQ_CHUNK (IRQ_ADC_STREAM + CHUNK_STREAM)
#define IRQ_LAST (IRQ_DAC_STREAM + HD_MODES - 1)
#if HD_MODES == 2
#define IRQS_TRANSFER_ERROR 11, 56, 57
#elif HD_MODES == 3
#define IRQS_TRANSFER_ERROR 11, 12, 56, 57, 58
#elif HD_MODES == 4
#define IRQS_TRANSFER_ERROR 11, 12, 13, 56, 57, 58, 59
#else
#define IRQS_TRANSFER_ERROR 11, 12, 13, 14, 56, 57, 58, 59, 60
#endif
#define VECTORS_TRANSFER_ERROR(handler) \
    [16 + IRQ_ADC_STREAM ... 16 + IRQ_CHUNK - 1] = handler, \
    [16 + IRQ_DAC_STREAM ... 16 + IRQ_LAST] = handler,

/* Up to three modes a tick is through within its chunk, on top of the longest lock; with four within the next one, with
 * five within the next two (tests/firmware/test_m4_budget.py). */
#define TICK_CHUNKS_LATE (HD_MODES <= 3 ? 0 : HD_MODES - 3)

#define GPIO_PORTS (GPIO_A | GPIO_B | GPIO_C)
#define INTERLOCK_PORT GPIOC
#define INTERLOCK_EXTICR EXTICR_PORT_C
#define IRQ_INTERLOCK IRQ_EXTI_5_TO_9
#define AMPLIFIER_FAULT 6 /* PC6, closed to ground; open: amplifier fault */
#define EMERGENCY_STOP 7  /* PC7, closed to ground; open: stop */

#define LINK_RX (&DMA1->STREAM[6])
#define LINK_RX_ROUTE 0u
#define LINK_RX_DATA ((uint32_t)(uintptr_t)&LPUART1->RDR)
#define LINK_RX_CLEAR DMA1->IFCR
#define LINK_RX_FLAGS (DMA_ALL << 24)
#define LINK_RX_RECOVER ((void)0) /* with OVRDIS there is no overrun */
#define LINK_TX (&DMA1->STREAM[7])
#define LINK_TX_ROUTE 0u
#define LINK_TX_DATA ((uint32_t)(uintptr_t)&LPUART1->TDR)
#define LINK_TX_CLEAR DMA1->IFCR
#define LINK_TX_FLAGS (DMA_ALL << 28)
#define LINK_TX_DONE (LINK_TX->NDTR == 0)

#define USART_TC (1u << 6)
#define USART_UE (1u << 0)
#define USART_OVRDIS (1u << 12) /* RM0440, 41.7.4: otherwise nothing is received while an overrun stands */

enum { REQUEST_ADC1 = 5, REQUEST_DAC1_1, REQUEST_DAC1_2, REQUEST_LPUART1_RX = 34, REQUEST_LPUART1_TX, REQUEST_ADC2,
       REQUEST_ADC3, REQUEST_ADC4, REQUEST_ADC5, REQUEST_DAC2_1 = 41, REQUEST_DAC3_1 = 102, REQUEST_DAC3_2 };

#endif
