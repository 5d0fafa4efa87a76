/* The registers that these chips have in the same place: PM0214 and PM0253 for the core's own, RM0090 rev 18, RM0440 rev 9 and
 * RM0433 rev 8 for the others. What differs is in the registers.h of a chip, in f4_g4.h and in f4_h7.h. */
#ifndef HD_STM32_H
#define HD_STM32_H

#include <stdint.h>

typedef volatile uint32_t reg_t;

typedef struct {
    reg_t MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFR[2];
} gpio_t;

typedef struct {
    reg_t CR1, CR2, SMCR, DIER, SR, EGR, CCMR[2], CCER, CNT, PSC, ARR, RCR, CCR[4];
} timer_t;

typedef struct {
    reg_t KR, PR, RLR, SR;
} watchdog_t;

typedef struct {
    reg_t CR, CFR, SR;
} window_watchdog_t;

typedef struct {
    reg_t DR, IDR, CR;
} crc_t;

#define TIM2 ((timer_t *)0x40000000)
#define TIM5 ((timer_t *)0x40000C00)

#define NVIC_ISER ((reg_t *)0xE000E100)
#define NVIC_ICPR ((reg_t *)0xE000E280)
#define NVIC_IPR ((volatile uint8_t *)0xE000E400)
#define SCB_ICSR (*(reg_t *)0xE000ED04)
#define SCB_AIRCR (*(reg_t *)0xE000ED0C)
#define SCB_SHPR3 (*(reg_t *)0xE000ED20)
#define SCB_CPACR (*(reg_t *)0xE000ED88)
#define MPU_CTRL (*(reg_t *)0xE000ED94)
#define MPU_RNR (*(reg_t *)0xE000ED98)
#define MPU_RBAR (*(reg_t *)0xE000ED9C)
#define MPU_RASR (*(reg_t *)0xE000EDA0)

/* RCC: the fields of these names have the same bits */
#define CR_HSEON (1u << 16)
#define CR_HSERDY (1u << 17)
#define CR_HSEBYP (1u << 18)
#define CR_CSSON (1u << 19)
#define CR_PLLON (1u << 24)
#define CR_PLLRDY (1u << 25)
#define APB1_TIM2 (1u << 0)
#define APB1_TIM5 (1u << 3)
#define GPIO_A (1u << 0)
#define GPIO_B (1u << 1)
#define GPIO_C (1u << 2)

/* GPIO: the two bits of a pin in MODER and PUPDR, the four in AFR */
#define OUTPUT(pin) (1u << 2 * (pin))
#define ALTERNATE(pin) (2u << 2 * (pin))
#define ANALOGUE(pin) (3u << 2 * (pin))
#define PULL_UP(pin) (1u << 2 * (pin))
#define FUNCTION(pin, f) ((uint32_t)(f) << 4 * ((pin) % 8))

/* Switches a peripheral's clock on; it needs two cycles to arrive (ES0182 rev 14, 2.2.13). */
static inline void clock_on(reg_t *enable, uint32_t bits)
{
    *enable |= bits;
    (void)*enable;
}

#define PERIOD (TIMER_HZ / HD_SAMPLE_HZ) /* of TIM2, in ticks: that of the samples */
#define TIM_CEN (1u << 0)
#define TIM_UG (1u << 0)
#define TIM_MMS_OC1REF (4u << 4)
#define TIM_OC1M_PWM1 (6u << 4)

#define USART_RE (1u << 2)
#define USART_TE (1u << 3)
#define USART_DMAR (1u << 6)
#define USART_DMAT (1u << 7)

/* What the factory read of the internal reference, in 12 bits, and VDDA meanwhile: VREFINT_CALIBRATION in a chip's registers.h */
#define REFERENCE_READINGS 8
#define REFERENCE_TURNS 1000 /* of at least 4 cycles: 23 us, for the reference and the ADC to start */

#define IWDG_KEY_START 0xCCCCu
#define IWDG_KEY_WRITE 0x5555u
#define IWDG_KEY_FEED 0xAAAAu
#define IWDG_UPDATING 3u /* SR: prescaler and reload are on their way to the slow clock */
#define WWDG_START (1u << 7 | 1u << 6) /* of CR, with what is left to count; below bit 6 it resets the chip */
#define AIRCR_RESET (0x05FAu << 16 | 1u << 2)
#define CPACR_FPU (0xFu << 20)
#define MPU_ENABLE (1u << 2 | 1u << 0)                /* the default map stays for all else */
#define MPU_NO_ACCESS_32_BYTES (1u << 28 | 4u << 1 | 1u) /* no execution, no access, 2^(4+1) bytes */
#define CRC_RESET (1u << 0)
#define EXTI_PVD (1u << 16)
#define IRQ_PVD 1
#define IRQ_EXTI_5_TO_9 23
#define IRQ_EXTI_10_TO_15 40
#define EXTICR_PORT_B(pin) (1u << 4 * ((pin) % 4))
#define EXTICR_PORT_C(pin) (2u << 4 * ((pin) % 4))
#define ICSR_PENDSVSET (1u << 28)
#define SHPR3_PENDSV(priority) ((uint32_t)(priority) << 16)

#endif
