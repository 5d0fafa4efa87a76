/* The program, the same on every board that runs in real time: the link in the main loop, everything else in the chunk
 * interrupt. Both share the core, and a chunk comes every 50 us, so the main loop holds the interrupt off only to obey a
 * frame that it has checked and to take a message that it will encode.
 */
#include "program.h"

#include "board.h"

#define PIECE 64 /* bytes */

static hd_core_t core;
static hd_carrier_t carrier;
static volatile bool came_round; /* the main loop, since the last control tick */

static void watch_main_loop(void)
{
    if (came_round) {
        came_round = false;
        board_feed_watchdog();
    }
}

/* Off without a drive; on in time, as a drive starts with a ramp from zero. */
static bool amplifiers_needed(void)
{
    return core.state == HD_STATE_LIVE || core.state == HD_STATE_TOOL || core.ramp > 0;
}

bool hd_on_interlock(void)
{
    static uint8_t before;
    uint8_t event = board_interlock();
    if (event != 0 && event != before) {
        hd_wire_log_entry_t entry = {board_now_us(), core.config.boot_id, event, 255, 0.0f};
        hd_log_add(&core.config.log, &entry);
    }
    before = event;
    bool ends_drive = event != 0 && amplifiers_needed();
    if (ends_drive) {
        hd_on_missed_chunk();
    } else if (event != 0) {
        hd_deadman_reset(&core.deadman);
    }
    return ends_drive;
}

static void show_sync(void)
{
    static bool shown;
    bool high = (core.tick_flags & HD_TICK_SYNC) != 0;
    if (high != shown) {
        shown = high;
        board_sync(high);
    }
}

/* (Inlined, it would have every chunk save more registers.) */
static __attribute__((noinline)) void watch_carrier(void)
{
    if (!hd_carrier_intact(&carrier)) {
        hd_lose_memory(&core, HD_DAMAGE_CARRIER, board_now_us());
    }
}

/* One tick in three parts: the first and the last work on the carrier, the middle one on the core. */
static inline void measure(hd_phasor_t measured_um[HD_MODES])
{
    hd_carrier_measure(&carrier, measured_um);
    core.clips = hd_carrier_clips(&carrier, core.control.turn, measured_um[core.control.turn]);
    if (hd_sweeps_carrier(&core.sweep)) {
        watch_carrier();
    }
}

static inline void compute(uint32_t t_us, const hd_phasor_t measured_um[HD_MODES], hd_phasor_t voltage_v[HD_MODES])
{
    hd_tick(&core, t_us, measured_um, voltage_v);
    board_enable_amplifiers(amplifiers_needed());
    show_sync();
    watch_main_loop();
}

static inline void drive(const hd_phasor_t voltage_v[HD_MODES])
{
    hd_carrier_tune(&carrier, core.drive_hz);
    hd_carrier_drive(&carrier, voltage_v);
}

void hd_on_tick(void)
{
    hd_phasor_t measured_um[HD_MODES], voltage_v[HD_MODES];
    (void)hd_on_interlock();
    measure(measured_um);
    compute(board_now_us(), measured_um, voltage_v);
    drive(voltage_v);
}

/* What travels between interrupts where a tick has one of its own. */
static struct {
    uint32_t t_us;
    hd_phasor_t measured_um[HD_MODES], voltage_v[HD_MODES];
} handed_on;

void hd_take_measurement(void)
{
    handed_on.t_us = board_now_us();
    measure(handed_on.measured_um);
}

void hd_on_measurement(void)
{
    (void)hd_on_interlock();
    compute(handed_on.t_us, handed_on.measured_um, handed_on.voltage_v);
}

void hd_give_voltage(void)
{
    drive(handed_on.voltage_v);
}

hd_carrier_t *hd_program_carrier(void)
{
    return &carrier;
}

void hd_silence_output(void)
{
    hd_phasor_t silence_v[HD_MODES] = {{0.0f, 0.0f}};
    board_enable_amplifiers(false);
    hd_carrier_drive(&carrier, silence_v);
}

void hd_on_missed_chunk(void)
{
    hd_silence_output();
    hd_lose_samples(&core, board_now_us());
}

static void receive_from_host(void)
{
    uint8_t bytes[PIECE];
    size_t n = board_read(bytes, sizeof bytes);
    for (size_t i = 0; i < n; i++) {
        if (hd_hear(&core, bytes[i])) {
            board_lock();
            hd_obey(&core, board_now_us());
            board_unlock();
        }
    }
}

/* Pending messages may be checked without the lock: one added by the interrupt now is sent in the next round. */
static void answer_host(void)
{
    uint8_t frame[HD_TRANSMIT_MIN];
    hd_message_t message;
    if (core.pending == 0 || board_write_room() < sizeof frame) {
        return;
    }
    board_lock();
    bool has_message = hd_say(&core, board_now_us(), &message);
    board_unlock();
    if (has_message) {
        board_write(frame, hd_message_encode(&message, frame));
    }
}

/* Once the answer to the host is on the line. */
static void follow_baud(void)
{
    static uint32_t baud;
    if ((core.baud | baud) == 0) {
        return; /* as it is with most hosts */
    }
    uint32_t asked = hd_line_baud(&core, board_now_us());
    if (asked != baud && (core.pending & HD_PENDING_VERDICT) == 0 && board_set_baud(asked)) {
        baud = asked;
    }
}

static void keep_log(void)
{
    static uint32_t kept_check;
    if (core.config.log.check != kept_check) {
        board_lock();
        hd_log_t log = core.config.log;
        board_unlock();
        kept_check = log.check;
        board_keep_log(&log);
    }
}

int main(void)
{
    hd_config_t config;
    hd_converters_t converters;
    board_start(&config, &converters);
    bool samples = hd_carrier_init(&carrier, &converters);
    if (!samples) {
        config.model[0].gain_um_per_v_s = 0.0f; /* the core refuses a plate without gain, and reports it to the host */
    }
    hd_init(&core, &config, board_now_us());
    if (samples) {
        board_run();
    }
    for (;;) {
        receive_from_host();
        answer_host();
        follow_baud();
        keep_log();
        came_round = true;
        board_wait();
    }
}
