/* The few registers of an STM32F405 that QEMU's netduinoplus2 emulates and this board uses (RM0090). Clocks, pins, DAC, ADC
 * and DMA are absent there: they read as zero and swallow what is written. */
#ifndef HD_QEMU_REGISTERS_H
#define HD_QEMU_REGISTERS_H

#include <stdint.h>

typedef struct {
    volatile uint32_t SR, DR, BRR, CR1;
} usart_t;

typedef struct {
    volatile uint32_t CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR;
} timer_t;

#define USART1 ((usart_t *)0x40011000u)
#define USART2 ((usart_t *)0x40004400u)
#define TIM2 ((timer_t *)0x40000000u)
#define TIM3 ((timer_t *)0x40000400u)
#define NVIC_ISER ((volatile uint32_t *)0xE000E100u)
#define NVIC_IPR ((volatile uint8_t *)0xE000E400u)
#define SCB_CPACR (*(volatile uint32_t *)0xE000ED88u)

#define USART_SR_RXNE (1u << 5)
#define USART_CR1_RE (1u << 2)
#define USART_CR1_TE (1u << 3)
#define USART_CR1_RXNEIE (1u << 5)
#define USART_CR1_UE (1u << 13)

#define TIM_CR1_CEN 1u
#define TIM_DIER_UIE 1u

#define CPACR_FPU (0xFu << 20)

enum { TIM3_IRQ = 29, USART1_IRQ = 37, USART2_IRQ = 38, IRQS = 82 };

#endif
