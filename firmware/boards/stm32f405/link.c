/* Received bytes run round a ring that the main loop follows; what is sent has the buffer to itself until it is on the
 * line. The main loop wakes at every chunk, so either way 50 us are lost at most.
 */
#include "link.h"

#include <string.h>

#include "clock.h"
#include "registers.h"
#include "setup.h"

#define RING 1024  /* 11 ms at 921600 baud; the main loop comes round every 50 us */
#define BUFFER 512
#define TX_STREAM (&DMA2->STREAM[7])
#define RX_STREAM (&DMA2->STREAM[2])
#define ALTERNATE(pin) (2u << 2 * (pin))
#define USART_FUNCTION(pin) (7u << 4 * ((pin) % 8))

static volatile uint8_t ring[RING];
static uint32_t ring_read;
static uint8_t sent[BUFFER];

void link_start(void)
{
    RCC->AHB1ENR |= AHB1_GPIOA | AHB1_DMA2;
    RCC->APB2ENR |= APB2_USART1;
    (void)RCC->APB2ENR;
    GPIOA->PUPDR |= 1u << 2 * 10; /* an open input is a line at rest, not noise */
    GPIOA->AFR[1] |= USART_FUNCTION(9) | USART_FUNCTION(10);
    GPIOA->MODER |= ALTERNATE(9) | ALTERNATE(10);
    USART1->BRR = (APB2_HZ + LINK_BAUD / 2) / LINK_BAUD; /* 16 samples a bit: in 1/16 of APB2_HZ / 16 */
    USART1->CR3 = USART_DMAR | USART_DMAT;
    USART1->CR1 = USART_UE | USART_RE | USART_TE;

    RX_STREAM->PAR = (uint32_t)(uintptr_t)&USART1->DR;
    RX_STREAM->M0AR = (uint32_t)(uintptr_t)ring;
    RX_STREAM->NDTR = RING;
    RX_STREAM->CR = DMA_CHANNEL(4) | DMA_MINC | DMA_CIRC | DMA_PRIORITY(1) | DMA_EN;
    TX_STREAM->PAR = (uint32_t)(uintptr_t)&USART1->DR;
    TX_STREAM->M0AR = (uint32_t)(uintptr_t)sent;
}

size_t link_read(uint8_t *bytes, size_t capacity)
{
    uint32_t written = RING - RX_STREAM->NDTR;
    size_t n = 0;
    while (n < capacity && ring_read != written % RING) {
        bytes[n++] = ring[ring_read];
        ring_read = (ring_read + 1) % RING;
    }
    return n;
}

size_t link_write_room(void)
{
    return (TX_STREAM->CR & DMA_EN) != 0 ? 0 : BUFFER;
}

void link_write(const uint8_t *bytes, size_t n)
{
    memcpy(sent, bytes, n);
    DMA2->HIFCR = DMA_ALL << 22; /* stream 7 */
    TX_STREAM->NDTR = (uint32_t)n;
    __asm volatile("dsb" : : : "memory"); /* the bytes are in memory before the stream reads them */
    TX_STREAM->CR = DMA_CHANNEL(4) | DMA_MINC | DMA_TO_PERIPHERAL | DMA_EN;
}
