/* The firmware in QEMU's netduinoplus2, with the plate inside the emulator.
 *
 * USART1 is the line, USART2 the bench (emulated/emulation.h). TIM2 counts microseconds and is the clock; TIM3 only pokes,
 * for QEMU's timers fire late: each time, all chunks that are due by the clock are run. The converters, their DMA and
 * their interrupt do not exist there, so this board proves the core, the main program and the link, not the timing of
 * boards/stm32f405.
 */
#include "board.h"
#include "emulation.h"
#include "registers.h"

#define TIMER_HZ 1000000000u /* of QEMU's timers, independent of the clock setup */
#define POKE_HZ 4000u
#define CATCH_UP 400 /* chunks in one interrupt, 20 ms: they take QEMU about a quarter of that */
#define LATER 0x80u  /* a priority below the ports' */
#define RING 2048    /* a power of two, several of the longest frames */

/* Bytes from an interrupt to the main loop. */
typedef struct {
    volatile uint32_t put, got;
    uint8_t bytes[RING];
} ring_t;

static hd_emulation_t emulation;
static ring_t line, bench;

/* Written by the emulator's command line before the reset: `-device loader,addr=0x20000000,...`. Else it is zero. */
static volatile const hd_emulation_options_t options __attribute__((section(".options")));

static void take(ring_t *ring, usart_t *usart)
{
    while (usart->SR & USART_SR_RXNE) {
        uint8_t byte = (uint8_t)usart->DR;
        if (ring->put - ring->got < RING) {
            ring->bytes[ring->put % RING] = byte;
            ring->put++;
        }
    }
}

void usart1_handler(void)
{
    take(&line, USART1);
}

void usart2_handler(void)
{
    take(&bench, USART2);
}

static bool get(ring_t *ring, uint8_t *byte)
{
    if (ring->got == ring->put) {
        return false;
    }
    *byte = ring->bytes[ring->got % RING];
    ring->got++;
    return true;
}

static void put(usart_t *usart, const uint8_t *bytes, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        usart->DR = bytes[i];
    }
}

static void report(void)
{
    hd_bench_report_t report = hd_emulation_report(&emulation);
    put(USART2, (const uint8_t *)&report, sizeof report);
}

static uint32_t clock_us(void)
{
    return TIM2->CNT + options.t_start_us;
}

void tim3_handler(void)
{
    TIM3->SR = 0;
    for (uint32_t due = hd_emulation_due(&emulation, clock_us(), CATCH_UP); due > 0; due--) {
        if (hd_emulation_chunk(&emulation)) {
            report();
        }
    }
}

static void open_port(usart_t *usart)
{
    usart->CR1 = USART_CR1_UE | USART_CR1_RE | USART_CR1_TE | USART_CR1_RXNEIE;
}

static void enable_interrupt(int irq)
{
    NVIC_ISER[irq / 32] = 1u << (irq % 32);
}

void board_start(hd_config_t *config, hd_converters_t *converters)
{
    hd_emulation_options_t given = options;
    hd_emulation_start(&emulation, &given, config, converters);
    open_port(USART1);
    open_port(USART2);
    enable_interrupt(USART1_IRQ);
    enable_interrupt(USART2_IRQ);
}

/* The first report signals to the bench that the ports are open. */
void board_run(void)
{
    report();
    if (emulation.stepped) {
        return;
    }
    TIM2->PSC = TIMER_HZ / 1000000u - 1u;
    TIM2->CNT = 0;
    TIM2->CR1 = TIM_CR1_CEN;
    TIM3->DIER = TIM_DIER_UIE;
    TIM3->CR1 = TIM_CR1_CEN;
    NVIC_IPR[TIM3_IRQ] = LATER; /* each byte waits for its interrupt, and the next byte for that */
    enable_interrupt(TIM3_IRQ);
    TIM3->ARR = TIMER_HZ / POKE_HZ; /* the last and only: any other write would be added to its period there */
}

static bool in_interrupt(void)
{
    uint32_t exception;
    __asm volatile("mrs %0, ipsr" : "=r"(exception));
    return exception != 0;
}

uint32_t board_now_us(void)
{
    bool at_tick = emulation.stepped || in_interrupt();
    return at_tick ? emulation.t_us : hd_emulation_now_us(&emulation, clock_us());
}

size_t board_read(uint8_t *bytes, size_t capacity)
{
    size_t n = 0;
    while (hd_emulation_may_read(&emulation, line.put) && n < capacity && get(&line, &bytes[n])) {
        n++;
    }
    emulation.line_read += (uint32_t)n;
    return n;
}

size_t board_write_room(void)
{
    return RING; /* QEMU accepts every byte, and blocks the board until it is read */
}

void board_write(const uint8_t *bytes, size_t n)
{
    put(USART1, bytes, n);
    emulation.line_written += (uint32_t)n;
}

void board_enable_amplifiers(bool enable)
{
    emulation.amplifiers_on = enable;
}

void board_lock(void)
{
    __asm volatile("cpsid i" ::: "memory");
}

void board_unlock(void)
{
    __asm volatile("cpsie i" ::: "memory");
}

/* With the interrupts held off, one that comes between the look and the sleep still ends the sleep. */
static void sleep_unless(bool busy)
{
    board_lock();
    bool unread = line.got != line.put && hd_emulation_may_read(&emulation, line.put);
    if (!busy && !unread && bench.got == bench.put) {
        __asm volatile("wfi" ::: "memory");
    }
    board_unlock();
}

void board_wait(void)
{
    uint8_t byte;
    while (get(&bench, &byte)) {
        hd_emulation_hear(&emulation, byte);
    }
    enum hd_turn turn = emulation.stepped ? hd_emulation_turn(&emulation) : HD_TURN_WAITS;
    if (turn == HD_TURN_REPORTS) {
        report();
    }
    sleep_unless(turn != HD_TURN_WAITS);
}

/* There is no watchdog to feed, and no memory that outlives the process. */

void board_feed_watchdog(void)
{
}

void board_keep_log(const hd_log_t *log)
{
    (void)log;
}
