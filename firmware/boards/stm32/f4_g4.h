/* What the STM32F405 and the STM32G474 have in the same place, and the STM32H743 elsewhere: RM0090 rev 18 and RM0440 rev 9. */
#ifndef HD_STM32_F4_G4_H
#define HD_STM32_F4_G4_H

#include "stm32.h"

#define INTERNAL_HZ 16000000

typedef struct {
    reg_t CR, SWTRIGR, DHR12R1, DHR12L1, DHR8R1, DHR12R2, DHR12L2, DHR8R2, DHR12RD, DHR12LD, DHR8RD, DOR1, DOR2, SR, CCR, MCR;
} dac_t;

typedef struct {
    reg_t MEMRMP, CFGR, EXTICR[4];
} syscfg_t;

typedef struct {
    reg_t IMR, EMR, RTSR, FTSR, SWIER, PR;
} exti_t;

#define WWDG ((window_watchdog_t *)0x40002C00)
#define IWDG ((watchdog_t *)0x40003000)
#define CRC ((crc_t *)0x40023000)
#define DBGMCU_APB1_FZ (*(reg_t *)0xE0042008)

#define SET_PLL(config) (RCC->PLLCFGR = (config))
#define CFGR_SWS (3u << 2)
#define APB1_PWR (1u << 28)
#define CRC_CLOCK &RCC->AHB1ENR, 1u << 12
#define PWR_CLOCK &RCC->APB1ENR, APB1_PWR
#define WWDG_CLOCK &RCC->APB1ENR, 1u << 11
#define SYSCFG_CLOCK &RCC->APB2ENR, APB2_SYSCFG
#define RESET_FLAGS RCC->CSR
#define CSR_PINRSTF (1u << 26)
#define CSR_POWER_UP (1u << 27) /* of the STM32G474: or a brown-out */
#define CSR_SFTRSTF (1u << 28)
#define CSR_IWDGRSTF (1u << 29)
#define CSR_WWDGRSTF (1u << 30)
#define CSR_LPWRRSTF (1u << 31)

/* DAC; channel 2's bits are 16 higher */
#define DAC_EN (1u << 0)
#define DAC_DMAEN (1u << 12)
#define DAC_UNDERRUNS (1u << 13 | 1u << 29)

/* A halted core stops TIM2, and not IWDG, WWDG or any other. */
#define STOP_SAMPLES_ON_HALT (DBGMCU_APB1_FZ = 1u << 0)

#define CONVERTER_LAG_S(mode) 1.0e-6f /* sampling.c: half a sample late, and half a sample because it is held for one */
#define SAMPLES_AT (PERIOD / 2)       /* of TIM2's period, after the DACs moved */
#define STREAMED                      /* where what the DMA reads and writes lies: in any memory of the program's */

#endif
