/* The registers of the STM32F405 that this board uses, and no others: RM0090 rev 18, PM0214 for the core's own. */
#ifndef HD_F405_REGISTERS_H
#define HD_F405_REGISTERS_H

#include <stdint.h>

typedef volatile uint32_t reg_t;

typedef struct {
    reg_t MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFR[2];
} gpio_t;

typedef struct {
    reg_t CR, PLLCFGR, CFGR, CIR, AHB1RSTR, AHB2RSTR, AHB3RSTR, _0, APB1RSTR, APB2RSTR, _1[2], AHB1ENR, AHB2ENR, AHB3ENR,
        _2, APB1ENR, APB2ENR, _3[2], AHB1LPENR, AHB2LPENR, AHB3LPENR, _4, APB1LPENR, APB2LPENR, _5[2], BDCR, CSR;
} rcc_t;

typedef struct {
    reg_t ACR;
} flash_t;

typedef struct {
    reg_t CR1, CR2, SMCR, DIER, SR, EGR, CCMR[2], CCER, CNT, PSC, ARR;
} timer_t;

typedef struct {
    reg_t CR, SWTRIGR, DHR12R1, DHR12L1, DHR8R1, DHR12R2, DHR12L2, DHR8R2, DHR12RD, DHR12LD, DHR8RD, DOR1, DOR2, SR;
} dac_t;

typedef struct {
    reg_t SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR1, SQR2, SQR3, JSQR, JDR[4], DR;
} adc_t;

typedef struct {
    reg_t CSR, CCR, CDR;
} adc_common_t;

typedef struct {
    reg_t CR, NDTR, PAR, M0AR, M1AR, FCR;
} dma_stream_t;

typedef struct {
    reg_t LISR, HISR, LIFCR, HIFCR;
    dma_stream_t STREAM[8];
} dma_t;

typedef struct {
    reg_t SR, DR, BRR, CR1, CR2, CR3;
} usart_t;

typedef struct {
    reg_t KR, PR, RLR, SR;
} watchdog_t;

#define RCC ((rcc_t *)0x40023800)
#define FLASH ((flash_t *)0x40023C00)
#define GPIOA ((gpio_t *)0x40020000)
#define GPIOB ((gpio_t *)0x40020400)
#define TIM2 ((timer_t *)0x40000000)
#define TIM5 ((timer_t *)0x40000C00)
#define IWDG ((watchdog_t *)0x40003000)
#define DAC ((dac_t *)0x40007400)
#define USART1 ((usart_t *)0x40011000)
#define ADC1 ((adc_t *)0x40012000)
#define ADC2 ((adc_t *)0x40012100)
#define ADC ((adc_common_t *)0x40012300)
#define DMA1 ((dma_t *)0x40026000)
#define DMA2 ((dma_t *)0x40026400)

#define DBGMCU_APB1_FZ (*(reg_t *)0xE0042008)
#define NVIC_ISER ((reg_t *)0xE000E100)
#define NVIC_ICPR ((reg_t *)0xE000E280)
#define NVIC_IPR ((volatile uint8_t *)0xE000E400)
#define SCB_AIRCR (*(reg_t *)0xE000ED0C)
#define SCB_CPACR (*(reg_t *)0xE000ED88)
#define UNIQUE_ID ((const reg_t *)0x1FFF7A10) /* 96 bits */

/* RCC */
#define CR_HSION (1u << 0)
#define CR_HSIRDY (1u << 1)
#define CR_HSEON (1u << 16)
#define CR_HSERDY (1u << 17)
#define CR_CSSON (1u << 19)
#define CR_PLLON (1u << 24)
#define CR_PLLRDY (1u << 25)
#define PLLCFGR_SRC_HSE (1u << 22)
#define CFGR_SW_PLL (2u << 0)
#define CFGR_SWS (3u << 2)
#define CFGR_SWS_PLL (2u << 2)
#define CFGR_PPRE1_DIV4 (5u << 10)
#define CFGR_PPRE2_DIV2 (4u << 13)
#define AHB1_GPIOA (1u << 0)
#define AHB1_GPIOB (1u << 1)
#define AHB1_DMA1 (1u << 21)
#define AHB1_DMA2 (1u << 22)
#define APB1_TIM2 (1u << 0)
#define APB1_TIM5 (1u << 3)
#define APB1_DAC (1u << 29)
#define APB2_USART1 (1u << 4)
#define APB2_ADC1 (1u << 8) /* its reset bit resets all three converters */
#define APB2_ADC2 (1u << 9)
#define CSR_RMVF (1u << 24)
#define CSR_BORRSTF (1u << 25)
#define CSR_PINRSTF (1u << 26)
#define CSR_PORRSTF (1u << 27)
#define CSR_SFTRSTF (1u << 28)
#define CSR_IWDGRSTF (1u << 29)
#define CSR_WWDGRSTF (1u << 30)
#define CSR_LPWRRSTF (1u << 31)

/* Timers */
#define TIM_CEN (1u << 0)
#define TIM_UG (1u << 0)
#define TIM_MMS_UPDATE (2u << 4)

/* DAC; channel 2's bits are 16 higher */
#define DAC_EN (1u << 0)
#define DAC_TEN (1u << 2)
#define DAC_TSEL_TIM2 (4u << 3)
#define DAC_DMAEN (1u << 12)
#define DAC_SR_DMAUDR1 (1u << 13)
#define DAC_BOTH(bits) ((bits) | (bits) << 16)

/* ADC */
#define ADC_SR_OVR (1u << 5)
#define ADC_ADON (1u << 0)
#define ADC_ALIGN_LEFT (1u << 11)
#define ADC_EXTSEL_TIM2_TRGO (6u << 24)
#define ADC_EXTEN_RISING (1u << 28)
#define ADC_MULTI_SIMULTANEOUS (6u << 0)
#define ADC_DDS (1u << 13) /* requests go on after the buffer's first round */
#define ADC_DMA_PAIRS (2u << 14)
#define ADC_PRE_DIV4 (1u << 16)

/* DMA */
#define DMA_EN (1u << 0)
#define DMA_HTIE (1u << 3)
#define DMA_TCIE (1u << 4)
#define DMA_TO_PERIPHERAL (1u << 6)
#define DMA_CIRC (1u << 8)
#define DMA_MINC (1u << 10)
#define DMA_WORDS (2u << 11 | 2u << 13) /* PSIZE, MSIZE; 0 is bytes */
#define DMA_PRIORITY(p) ((uint32_t)(p) << 16)
#define DMA_CHANNEL(c) ((uint32_t)(c) << 25)
#define DMA_FE 0x01u
#define DMA_DME 0x04u
#define DMA_TE 0x08u
#define DMA_HT 0x10u
#define DMA_TC 0x20u
#define DMA_ALL 0x3Du

/* USART */
#define USART_RE (1u << 2)
#define USART_TE (1u << 3)
#define USART_UE (1u << 13)
#define USART_DMAR (1u << 6)
#define USART_DMAT (1u << 7)

#define IWDG_KEY_START 0xCCCCu
#define IWDG_KEY_WRITE 0x5555u
#define IWDG_KEY_FEED 0xAAAAu
#define DBG_TIM2_STOP (1u << 0)
#define DBG_IWDG_STOP (1u << 12)
#define AIRCR_RESET (0x05FAu << 16 | 1u << 2)
#define CPACR_FPU (0xFu << 20)
#define IRQ_DMA2_STREAM0 56

#endif
