/* The registers that the STM32F405 has in its own way: RM0090 rev 18. */
#ifndef HD_F405_REGISTERS_H
#define HD_F405_REGISTERS_H

#include "f4_g4.h"
#include "f4_h7.h"

#define CRYSTAL_HZ 8000000
#define CORE_HZ 168000000
#define TIMER_HZ 84000000 /* on APB1 */
#define APB2_HZ 84000000

typedef struct {
    reg_t CR, PLLCFGR, CFGR, CIR, AHB1RSTR, AHB2RSTR, AHB3RSTR, _0, APB1RSTR, APB2RSTR, _1[2], AHB1ENR, AHB2ENR, AHB3ENR,
        _2, APB1ENR, APB2ENR, _3[2], AHB1LPENR, AHB2LPENR, AHB3LPENR, _4, APB1LPENR, APB2LPENR, _5[2], BDCR, CSR;
} rcc_t;

typedef struct {
    reg_t ACR, KEYR, OPTKEYR, SR, CR, OPTCR;
} flash_t;

typedef struct {
    reg_t CR, CSR;
} power_t;

typedef struct {
    reg_t SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR1, SQR2, SQR3, JSQR, JDR[4], DR;
} adc_t;

typedef struct {
    reg_t CSR, CCR, CDR;
} adc_common_t;

typedef struct {
    reg_t SR, DR, BRR, CR1, CR2, CR3;
} usart_t;

#define RCC ((rcc_t *)0x40023800)
#define FLASH ((flash_t *)0x40023C00)
#define GPIOA ((gpio_t *)0x40020000)
#define GPIOB ((gpio_t *)0x40020400)
#define PWR ((power_t *)0x40007000)
#define DAC ((dac_t *)0x40007400)
#define USART1 ((usart_t *)0x40011000)
#define ADC1 ((adc_t *)0x40012000)
#define ADC2 ((adc_t *)0x40012100)
#define ADC ((adc_common_t *)0x40012300)
#define SYSCFG ((syscfg_t *)0x40013800)
#define EXTI ((exti_t *)0x40013C00)
#define DMA1 ((dma_t *)0x40026000)
#define DMA2 ((dma_t *)0x40026400)
#define UNIQUE_ID ((const reg_t *)0x1FFF7A10) /* 96 bits */
#define VREFINT_CALIBRATION (*(const volatile uint16_t *)0x1FFF7A2A) /* DS8626, embedded internal reference: at 3.3 V, 30 C */
#define VREFINT_CALIBRATED_V 3.3f
#define REFERENCE_IS_WATCHED 0 /* the one ADC that reaches it has no time between its sensors' samples */

/* RCC. VCO at 336 MHz from 1 MHz: 168 for the core, 48 for a USB that is not used. */
#define PLL_CONFIG(input_hz, source) ((uint32_t)(input_hz) / 1000000 | 336u << 6 | (source) | 7u << 24)
#define PLL_CRYSTAL (1u << 22)
#define PLL_INTERNAL 0u
#define CFGR_SW_PLL 2u
#define CFGR_PPRE1_DIV4 (5u << 10)
#define CFGR_PPRE2_DIV2 (4u << 13)
#define GPIO_ENR RCC->AHB1ENR
#define AHB1_DMA1 (1u << 21)
#define AHB1_DMA2 (1u << 22)
#define APB1_DAC (1u << 29)
#define APB2_USART1 (1u << 4)
#define APB2_ADC1 (1u << 8) /* its reset bit resets all three converters */
#define APB2_ADC2 (1u << 9)
#define APB2_SYSCFG (1u << 14)
#define CSR_RMVF (1u << 24)
#define CSR_BROWN_OUT (1u << 25)

#define WWDG_UNIT (0u << 7 | 0x7Fu) /* no window; 42 MHz / 4096: 97.5 us */

#define ACR_168_MHZ 0x705u /* 5 wait states; prefetch, instruction and data cache on */
#define OPTCR_BOR_OFF (3u << 2) /* 0 is level 3 */
#define OPTCR_BOR_LEVEL_3 0u
#define PWR_PVDE (1u << 4)
#define PWR_PLS_2V9 (7u << 5)
#define PWR_PVDO (1u << 2) /* of CSR */

/* DAC */
#define DAC_TEN (1u << 2)
#define DAC_TSEL_TIM2 (4u << 3)
#define DAC_BOTH(bits) ((bits) | (bits) << 16)

/* ADC */
#define ADC_SR_EOC (1u << 1)
#define ADC_SR_OVR (1u << 5)
#define ADC_ADON (1u << 0)
#define ADC_SWSTART (1u << 30)
#define ADC_VREFINT 17              /* of ADC1 alone: RM0090, 13.3.3 */
#define ADC_SAMPLE_480 (7u << 21)   /* of that channel: 22.9 us at 21 MHz, where it needs 10 (DS8626) */
#define ADC_TSVREFE (1u << 23)      /* of CCR */
#define ADC_EXTSEL_TIM2_TRGO (6u << 24)
#define ADC_EXTEN_FALLING (2u << 28)
#define ADC_MULTI_SIMULTANEOUS (6u << 0)
#define ADC_DDS (1u << 13) /* requests go on after the buffer's first round */
#define ADC_DMA_PAIRS (2u << 14)
#define ADC_PRE_DIV4 (1u << 16)

/* DMA */
#define DMA_CHANNEL(c) ((uint32_t)(c) << 25)

/* ADC1 requests of DMA2 stream 0, DAC1 of DMA1 stream 5, USART1 of DMA2 streams 2 and 7 */
#define CHUNK_FLAGS DMA2->LISR
#define CHUNK_CLEAR DMA2->LIFCR
#define CHUNK_ERROR 0x0Cu /* of the transfer, and of direct mode */
#define CHUNK_HALF 0x10u
#define CHUNK_COMPLETE 0x20u
#define IRQ_CHUNK 56
#define IRQS_TRANSFER_ERROR 16
#define VECTORS_TRANSFER_ERROR(handler) [16 + 16] = handler,
#define IRQ_LAST 56
#define TICK_CHUNKS_LATE 0

#define GPIO_PORTS (GPIO_A | GPIO_B)
#define INTERLOCK_PORT GPIOB
#define INTERLOCK_EXTICR EXTICR_PORT_B
#define IRQ_INTERLOCK IRQ_EXTI_10_TO_15
#define AMPLIFIER_FAULT 14 /* PB14, closed to ground; open: amplifier fault */
#define EMERGENCY_STOP 15  /* PB15, closed to ground; open: stop */

#define LINK_RX (&DMA2->STREAM[2])
#define LINK_RX_ROUTE DMA_CHANNEL(4)
#define LINK_RX_DATA ((uint32_t)(uintptr_t)&USART1->DR)
#define LINK_RX_CLEAR DMA2->LIFCR
#define LINK_RX_FLAGS (DMA_ALL << 16)
/* RM0090, 30.6.1, ORE: nothing is received until SR and then DR were read. The byte read is of a damaged frame. */
#define LINK_RX_RECOVER ((USART1->SR & USART_ORE) != 0 ? (void)USART1->DR : (void)0)
#define LINK_TX (&DMA2->STREAM[7])
#define LINK_TX_ROUTE DMA_CHANNEL(4)
#define LINK_TX_DATA LINK_RX_DATA
#define LINK_TX_CLEAR DMA2->HIFCR
#define LINK_TX_FLAGS (DMA_ALL << 22)
#define LINK_TX_DONE false /* the stream disables itself */

#define USART_ORE (1u << 3)
#define USART_TC (1u << 6)
#define USART_UE (1u << 13)

#endif
