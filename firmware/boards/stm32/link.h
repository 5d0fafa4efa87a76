/* The host's line, both directions by DMA, no interrupt. */
#ifndef HD_STM32_LINK_H
#define HD_STM32_LINK_H

#include <stddef.h>
#include <stdint.h>

void link_start(void);

/* Bytes that came since the last call, 0 if none. */
size_t link_read(uint8_t *bytes, size_t capacity);

/* Takes one piece at a time: there is room again when that is on the line. */
size_t link_write_room(void);
void link_write(const uint8_t *bytes, size_t n);

#endif
