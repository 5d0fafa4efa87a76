/* The firmware as an ordinary process: the shared program (main.c, whose main is renamed for this build), the signal
 * chain at 1 MHz and the simulated plate, in real time behind a pseudo-terminal.
 *
 *     hapticd-board [--link PATH] [--owned]           prints the terminal's name; PATH becomes a link to it
 *     hapticd-board --line FD --bench FD [--stepped]  for a program that starts it: open descriptors instead
 *
 * It ends on SIGTERM and SIGINT, when the line's other end is closed (--line), and with its input (--owned). The chunk
 * interrupt is a part of board_wait here, so nothing has to be locked.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sysexits.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "board.h"
#include "emulation.h"

#define CATCH_UP 4000 /* chunks at once, 0.2 s: they take about 5 ms */
#define SLEEP_MS 1 /* at most: two ticks come together */
#define STEPPED_SLEEP_MS 100 /* a signal may fall between the look at `stopping` and the sleep */
#define UNSENT 1024

int hd_program(void); /* main.c */

static struct {
    hd_emulation_options_t options;
    const char *link;
    int line, bench, owner; /* -1 for none */
} started = {.line = -1, .bench = -1, .owner = -1};

static hd_emulation_t emulation;
static uint8_t unsent[UNSENT]; /* what the line did not take at once */
static size_t unsent_n;
static volatile sig_atomic_t stopping;

static void stop(int signal_number)
{
    (void)signal_number;
    stopping = 1;
}

static _Noreturn void leave(int status)
{
    if (started.link != NULL) {
        unlink(started.link);
    }
    exit(status);
}

static _Noreturn void complain(const char *what)
{
    fprintf(stderr, "hapticd-board: %s: %s\n", what, strerror(errno));
    leave(EXIT_FAILURE);
}

static uint32_t clock_us(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint32_t)((uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u);
}

/* Our own hold on the terminal's other end: a daemon that leaves is no hang-up. */
static void open_terminal(void)
{
    int held;
    struct termios raw = {0};
    cfmakeraw(&raw);
    if (openpty(&started.line, &held, NULL, &raw, NULL) != 0) {
        complain("no pseudo-terminal");
    }
    const char *name = ttyname(held);
    if (started.link != NULL) {
        struct stat before;
        if (lstat(started.link, &before) == 0 && S_ISLNK(before.st_mode)) {
            unlink(started.link); /* of a process that was killed; anything else stays */
        }
        if (symlink(name, started.link) != 0) {
            const char *path = started.link;
            started.link = NULL; /* what is there is not ours */
            complain(path);
        }
    }
    printf("%s\n", name);
    fflush(stdout);
}

void board_start(hd_config_t *config, hd_converters_t *converters)
{
    if (!started.options.stepped) {
        started.options.t_start_us = clock_us();
    }
    hd_emulation_start(&emulation, &started.options, config, converters);
}

static void report(void)
{
    hd_bench_report_t report = hd_emulation_report(&emulation);
    if (started.bench >= 0 && write(started.bench, &report, sizeof report) < 0 && errno == EPIPE) {
        leave(EXIT_SUCCESS);
    }
}

/* The first report signals to the bench that the board runs. */
void board_run(void)
{
    report();
}

static bool running_chunks;

uint32_t board_now_us(void)
{
    bool at_tick = emulation.stepped || running_chunks;
    return at_tick ? emulation.t_us : hd_emulation_now_us(&emulation, clock_us());
}

size_t board_read(uint8_t *bytes, size_t capacity)
{
    int waiting = 0;
    ioctl(started.line, FIONREAD, &waiting);
    if (!hd_emulation_may_read(&emulation, emulation.line_read + (uint32_t)waiting)) {
        return 0;
    }
    ssize_t n = read(started.line, bytes, capacity);
    if (n == 0) {
        leave(EXIT_SUCCESS);
    }
    emulation.line_read += n > 0 ? (uint32_t)n : 0;
    return n > 0 ? (size_t)n : 0;
}

static void flush_line(void)
{
    ssize_t n = unsent_n > 0 ? write(started.line, unsent, unsent_n) : 0;
    if (n > 0) {
        unsent_n -= (size_t)n;
        memmove(unsent, unsent + n, unsent_n);
    }
}

size_t board_write_room(void)
{
    flush_line();
    return UNSENT - unsent_n;
}

void board_write(const uint8_t *bytes, size_t n)
{
    memcpy(unsent + unsent_n, bytes, n);
    unsent_n += n;
    emulation.line_written += (uint32_t)n;
    flush_line();
}

void board_enable_amplifiers(bool enable)
{
    emulation.amplifiers_on = enable;
}

void board_sync(bool high)
{
    (void)high;
}

bool board_set_baud(uint32_t baud)
{
    (void)baud;
    return true;
}

uint8_t board_interlock(void)
{
    return 0;
}

void board_lock(void)
{
}

void board_unlock(void)
{
}

static void read_bench(void)
{
    uint8_t byte;
    ssize_t n;
    while ((n = read(started.bench, &byte, 1)) > 0) {
        hd_emulation_hear(&emulation, byte);
    }
    if (n == 0) {
        leave(EXIT_SUCCESS);
    }
}

static void check_owner(void)
{
    char ignored[64];
    if (read(started.owner, ignored, sizeof ignored) == 0) {
        leave(EXIT_SUCCESS);
    }
}

static void sleep_until_something_comes(int timeout_ms)
{
    struct pollfd ports[] = {
        {.fd = started.line, .events = (short)(POLLIN | (unsent_n > 0 ? POLLOUT : 0))},
        {.fd = started.bench, .events = POLLIN},
        {.fd = started.owner, .events = POLLIN},
    };
    poll(ports, sizeof ports / sizeof *ports, timeout_ms);
    if (ports[1].revents != 0) {
        read_bench();
    }
    if (ports[2].revents != 0) {
        check_owner();
    }
}

static void run_due_chunks(void)
{
    running_chunks = true;
    for (uint32_t due = hd_emulation_due(&emulation, clock_us(), CATCH_UP); due > 0; due--) {
        if (hd_emulation_chunk(&emulation)) {
            report();
        }
    }
    running_chunks = false;
}

void board_wait(void)
{
    if (stopping) {
        leave(EXIT_SUCCESS);
    }
    if (!emulation.stepped) {
        sleep_until_something_comes(SLEEP_MS);
        run_due_chunks();
        return;
    }
    enum hd_turn turn = hd_emulation_turn(&emulation);
    if (turn == HD_TURN_REPORTS) {
        report();
    } else if (turn == HD_TURN_WAITS) {
        sleep_until_something_comes(STEPPED_SLEEP_MS);
    }
}

void board_feed_watchdog(void)
{
}

void board_keep_log(const hd_log_t *log)
{
    (void)log;
}

static _Noreturn void explain(void)
{
    fprintf(stderr, "usage: hapticd-board [--link PATH] [--owned] | --line FD --bench FD [--stepped] [--start-us T] "
                    "[--boot-id N]\n");
    exit(EX_USAGE);
}

static void take_options(int count, char **words)
{
    for (int i = 1; i < count; i++) {
        bool more = i + 1 < count;
        if (strcmp(words[i], "--owned") == 0) {
            started.owner = STDIN_FILENO;
        } else if (strcmp(words[i], "--stepped") == 0) {
            started.options.stepped = 1;
        } else if (strcmp(words[i], "--link") == 0 && more) {
            started.link = words[++i];
        } else if (strcmp(words[i], "--line") == 0 && more) {
            started.line = atoi(words[++i]);
        } else if (strcmp(words[i], "--bench") == 0 && more) {
            started.bench = atoi(words[++i]);
        } else if (strcmp(words[i], "--start-us") == 0 && more) {
            started.options.t_start_us = (uint32_t)strtoul(words[++i], NULL, 0);
        } else if (strcmp(words[i], "--boot-id") == 0 && more) {
            started.options.boot_id = (uint32_t)strtoul(words[++i], NULL, 0);
        } else {
            explain();
        }
    }
}

int main(int count, char **words)
{
    started.options.boot_id = (uint32_t)getpid();
    take_options(count, words);
    struct sigaction quietly = {.sa_handler = stop}; /* no SA_RESTART: poll has to return */
    sigaction(SIGTERM, &quietly, NULL);
    sigaction(SIGINT, &quietly, NULL);
    signal(SIGPIPE, SIG_IGN);
    if (started.line < 0) {
        open_terminal();
    }
    fcntl(started.line, F_SETFL, O_NONBLOCK);
    if (started.bench >= 0) {
        fcntl(started.bench, F_SETFL, O_NONBLOCK);
    }
    return hd_program();
}
