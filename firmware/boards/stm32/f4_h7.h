/* The DMA with streams, as the STM32F405 and the STM32H743 have it: RM0090 rev 18, 10.5, and RM0433 rev 8, 15. */
#ifndef HD_STM32_F4_H7_H
#define HD_STM32_F4_H7_H

#include "stm32.h"

typedef struct {
    reg_t CR, NDTR, PAR, M0AR, M1AR, FCR;
} dma_stream_t;

typedef struct {
    reg_t LISR, HISR, LIFCR, HIFCR;
    dma_stream_t STREAM[8];
} dma_t;

#define DMA_EN (1u << 0)
#define DMA_TEIE (1u << 2)
#define DMA_HTIE (1u << 3)
#define DMA_TCIE (1u << 4)
#define DMA_TO_PERIPHERAL (1u << 6)
#define DMA_CIRC (1u << 8)
#define DMA_MINC (1u << 10)
#define DMA_WORDS (2u << 11 | 2u << 13) /* PSIZE, MSIZE; 0 is bytes */
#define DMA_PRIORITY(p) ((uint32_t)(p) << 16)
#define DMA_ALL 0x3Du

#endif
