/* Received bytes run round a ring that the main loop follows; what is sent has the buffer to itself until it is on the
 * line. The main loop wakes at every chunk, so either way 50 us are lost at most.
 */
#include "link.h"

#include <string.h>

#include "board.h"
#include "chip.h"
#include "setup.h"

#define RING 1024  /* 3.4 ms at 3 Mbaud; the main loop comes round every 50 us */
#define BUFFER 512

STREAMED static volatile uint8_t ring[RING];
static uint32_t ring_read;
STREAMED static uint8_t sent[BUFFER];

static void receive(void)
{
    ring_read = 0;
    LINK_RX->PAR = LINK_RX_DATA;
    LINK_RX->M0AR = (uint32_t)(uintptr_t)ring;
    LINK_RX->NDTR = RING;
    LINK_RX->CR = LINK_RX_ROUTE | DMA_MINC | DMA_CIRC | DMA_PRIORITY(1) | DMA_EN;
}

static __attribute__((noinline)) void start_anew(void)
{
    LINK_RX_CLEAR = LINK_RX_FLAGS;
    receive();
}

void link_start(void)
{
    serial_start();
    receive();
    LINK_TX->PAR = LINK_TX_DATA;
    LINK_TX->M0AR = (uint32_t)(uintptr_t)sent;
}

static __attribute__((noinline)) size_t take(uint8_t *bytes, size_t capacity, uint32_t written)
{
    size_t n = 0;
    __asm volatile(".rept 8\n\tnop\n\t.endr"); /* counted when read, on its way to memory yet (RM0440, 12.4.3: after that) */
    while (n < capacity && ring_read != written) {
        bytes[n++] = ring[ring_read];
        ring_read = (ring_read + 1) % RING;
    }
    return n;
}

/* (Most turns of the main loop find nothing, and cost a register less to save for each that is not used.) */
size_t board_read(uint8_t *bytes, size_t capacity)
{
    if ((LINK_RX->CR & DMA_EN) == 0) { /* a transfer error ends the stream, and would leave a board that is deaf */
        start_anew();
    }
    uint32_t written = (RING - LINK_RX->NDTR) % RING;
    return ring_read == written ? 0 : take(bytes, capacity, written);
}

size_t board_write_room(void)
{
    return (LINK_TX->CR & DMA_EN) != 0 && !LINK_TX_DONE ? 0 : BUFFER;
}

bool board_set_baud(uint32_t baud)
{
    return board_write_room() > 0 && serial_set_baud(baud == 0 ? LINK_BAUD : baud);
}

void board_write(const uint8_t *bytes, size_t n)
{
    memcpy(sent, bytes, n);
    LINK_TX->CR = 0;
    LINK_TX_CLEAR = LINK_TX_FLAGS;
    LINK_TX->NDTR = (uint32_t)n;
    __asm volatile("dsb" : : : "memory"); /* the bytes are in memory before the stream reads them */
    LINK_TX->CR = LINK_TX_ROUTE | DMA_MINC | DMA_TO_PERIPHERAL | DMA_EN;
}
