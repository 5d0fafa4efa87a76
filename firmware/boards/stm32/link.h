/* The host's line, both directions by DMA, no interrupt: board_read, board_write, board_set_baud. */
#ifndef HD_STM32_LINK_H
#define HD_STM32_LINK_H

void link_start(void);

#endif
