/* The firmware's core: bytes from the host, measurements from the plate and an instant in; voltages and bytes out.
 *
 * No globals, no allocation, no clock: `now_us` is the board's free-running microsecond counter and may wrap at any
 * time. All calls on one core must exclude each other, except hd_hear, which a tick may interrupt: a board masks its
 * control interrupt around hd_obey and hd_say, which are short, and checks and makes frames outside.
 */
#ifndef HD_CORE_H
#define HD_CORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "codec.h"
#include "control.h"
#include "deadman.h"
#include "follow.h"
#include "log.h"
#include "memory.h"
#include "phasor.h"
#include "protocol.h"
#include "reference.h"
#include "telemetry.h"
#include "tools.h"

#define HD_COMMANDS 32U /* message types of the host are below */
#define HD_FIRMWARE_VERSION "0.2.0"

/* A message to the host, taken from the core under the lock and encoded outside of it. */
typedef struct {
    uint8_t type; /* enum hd_message */
    uint16_t n;   /* of the payload: telemetry of eight modes has 267 bytes */
    union {
        hd_wire_hello_t hello;
        hd_wire_status_t status;
        hd_wire_time_t time;
        hd_wire_verdict_t verdict;
        hd_wire_controller_t controller;
        hd_wire_sweep_point_t sweep_point;
        hd_wire_telemetry_t telemetry;
        hd_wire_log_t log;
    } payload;
} hd_message_t;

/* Any frame of the board's fits into a buffer of this size: type, payload and CRC. */
#define HD_TRANSMIT_MIN HD_LINE_SIZE(1 + sizeof(((hd_message_t *)0)->payload) + 2)

/* A frame from the host, validated independently of the core's state. */
typedef struct {
    bool valid;
    bool whole; /* but valid or not */
    size_t frame_n;
    uint32_t t_apply_us; /* of a REFERENCE, whose knots are these, within the limits */
    hd_polyline_t line;
    bool in_range;       /* a controller or a model that the core has a design for: this one */
    hd_design_t design;
} hd_staged_t;

typedef struct {
    uint32_t boot_id; /* changes with every reset, by which the host detects lost state */
    float control_hz;
    float drive_hz;
    float v_limit_v;
    float w_limit_um[HD_MODES];
    hd_mode_model_t model[HD_MODES];
    hd_wiring_t wiring; /* all zero: amplifier and sensor k belong to mode k */
    hd_gains_t gains;
    float output_delay_frac;   /* of a tick: from hd_tick to the voltage on the plate */
    bool latch_repeated_trips; /* three dead-man trips in ten seconds become a fault */
    uint8_t reset_cause;       /* enum hd_reset_cause */
    uint8_t features;          /* enum hd_feature */
    uint32_t image_crc, baud_max; /* as in HELLO */
    hd_log_t log;              /* what survived the reset; recovered by hd_init, and written to from then on */
} hd_config_t;

/* The part of a STATUS about one reference frame. */
typedef struct {
    uint16_t seq;
    bool applied;
    uint32_t t_received_us;
    uint32_t t_applied_us;
} hd_receipt_t;

/* Turns for which a mode or its sensor has not been believed, in a row. */
typedef struct {
    uint16_t over_amplitude, dead, backwards, clipped, swings;
    hd_phasor_t spare_um2_s; /* recent sum of the power that the mode took, beyond what any plate damps; q only goes to and fro */
    float w_um2;             /* recent sum of |W|^2 */
    hd_phasor_t answer_um_v; /* recent sum of innovations times the conjugate changes of voltage that followed them */
    float most_answer2;      /* of its magnitude, squared, since `swings` counts */
    bool struck;             /* large probes played right before that */
    hd_phasor_t asked_um;    /* a turn ago */
    float planned_v2;        /* recent sum of what the changes of voltage may be for other reasons, squared */
} hd_doubts_t;

/* Turns in a row in which a mode was driven hard and its sensor showed little, and the tick of the last. */
typedef struct {
    uint32_t turns, tick;
} hd_unheard_t;

enum hd_tick_flag {
    HD_TICK_SATURATED = 0x01, /* the reference needs more voltage than the limit */
    HD_TICK_LIMITED = 0x02,   /* the running reference was above the amplitude limit and scaled */
    HD_TICK_LIVE = 0x04,
    HD_TICK_DEADMAN = 0x08,   /* quiet after a dead-man timeout */
    HD_TICK_SYNC = 0x10,      /* the sync output is high */
};

/* What a tick needs comes first: a load reaches 1 KB from the start. */
typedef struct {
    hd_control_t control;
    float drive_hz; /* what the board's oscillator should run at: the follower's, but for a sweep */
    uint8_t state; /* enum hd_state */
    uint8_t fault; /* enum hd_fault */
    bool tripped;
    uint16_t ramp; /* 0 is no drive, ramp_ticks full drive */
    hd_doubts_t doubts[HD_MODES];
    hd_phasor_t previous_v[HD_MODES];
    hd_phasor_t reference_um[HD_MODES]; /* last one followed; start of a ramp down */
    hd_phasor_t asked_um[HD_MODES];     /* the same after the ramp: input of the control law */
    bool clips;                         /* the sensor whose turn it is met a rail of its converter: from the board */
    uint32_t t_reached_us;              /* last tick at which the voltage sufficed */
    hd_phasor_t sensor_um[HD_MODES];    /* finite */
    hd_phasor_t measured_um[HD_MODES];  /* of the modes */
    hd_phasor_t voltage_v[HD_MODES];    /* of the amplifiers */
    hd_sweep_t sweep;
    uint8_t tick_flags;
    uint8_t status_flags; /* all that happened since the last STATUS */
    hd_reach_t reach[HD_MODES];
    float allowed_v;      /* of an amplifier, by reach_watch.h */
    bool asks;            /* the sensors, by small probes on the voltages */
    uint8_t trusted, due; /* sensors, one bit each: trusted; to be judged, again before the trust ends */
    uint8_t suspect;       /* sensors that have shown nothing since the start, or something else than they should */
    uint16_t suspect_ticks; /* for which a mode has moved that one sensors */
    uint16_t follow_ticks; /* for which what the voltage does is still followed */
    uint32_t struck_tick; /* when large probes last played; 0: never */
    uint32_t probes;      /* a shift register, by which signs */
    uint16_t pulse_ticks; /* until the sync output may rise again */

    bool has_seq;
    hd_receipt_t newest;  /* last accepted reference */
    hd_receipt_t applied; /* last one that has taken effect */
    uint32_t bad_frames;
    uint32_t late_frames;
    uint32_t missed_chunks;
    uint16_t refused_seq; /* of the session's last REFERENCE that was not taken */
    uint8_t refusal;      /* enum hd_refusal */

    uint16_t pending; /* messages to send, one bit of hd_pending each: the transmit queue */
    bool acknowledge; /* the pending STATUS is about `applied` */
    uint32_t t_status_us;
    uint16_t statuses;
    uint64_t time_request_ns;
    uint32_t t_time_request_us;
    uint32_t baud;                /* set by the host; 0: the one that the board started with */
    uint32_t t_heard_us;          /* the last valid frame */
    uint32_t verdicts;            /* commands with a pending verdict, one bit per message type */
    uint8_t verdict[HD_COMMANDS]; /* enum hd_verdict, by message type */

    hd_settled_t settled; /* from here to the configuration's log nothing changes once hd_init is through: memory.h */
    uint16_t ramp_ticks;
    uint16_t distrust_turns;
    uint16_t swing_turns, recent_ticks;
    uint16_t trust_turns, renew_turns, settling_turns, followed_ticks, patience_ticks, acquitted_ticks;
    float surprise_um2;
    float suspect_um[HD_MODES], hurry_um[HD_MODES], sure_frac;
    float ask_um[HD_MODES], probe_um[HD_MODES]; /* from where on a mode's sensors are asked, and what a probe moves it by */
    float missed_frac;    /* of the sums that trust comes from, that a tick leaves */
    float recent_frac;    /* of the recent sums, that a turn leaves */
    float least_swing_v2;
    hd_config_t config;
    hd_deadman_t deadman;
    hd_follower_t follower;
    hd_tool_t tool;
    hd_telemetry_t telemetry;
    hd_timeline_t timeline;
    hd_receiver_t receiver;
    hd_staged_t staged;
    hd_unheard_t unheard[HD_MODES];
} hd_core_t;

/* Returns false, with the output disabled permanently, if the configuration is invalid. */
bool hd_init(hd_core_t *core, const hd_config_t *config, uint32_t now_us);

/* Takes any bytes from the line, in pieces of any size: hd_hear and, where a frame ends, hd_obey. */
void hd_receive(hd_core_t *core, const uint8_t *bytes, size_t n, uint32_t now_us);

/* One control tick: the sensors' mean over the tick just ended in, the amplifiers' voltages to apply out. */
void hd_tick(hd_core_t *core, uint32_t now_us, const hd_phasor_t sensor_um[HD_MODES],
             hd_phasor_t voltage_v[HD_MODES]);

/* The two halves of hd_receive. The first validates, limits and designs: it may take long, and a tick may interrupt it.
 * True if hd_obey is to be called before the next byte. */
bool hd_hear(hd_core_t *core, uint8_t byte);
void hd_obey(hd_core_t *core, uint32_t now_us);

/* Writes as many whole pending frames as fit and returns their length: hd_say and hd_message_encode, repeated. */
size_t hd_transmit(hd_core_t *core, uint32_t now_us, uint8_t *out, size_t capacity);

/* Takes the most urgent pending message; false if there is none. */
bool hd_say(hd_core_t *core, uint32_t now_us, hd_message_t *message);

/* Its frame; `out` holds HD_TRANSMIT_MIN. Returns its length. */
size_t hd_message_encode(const hd_message_t *message, uint8_t *out);

/* Zero voltage now; discards references, trajectories and integrals. */
void hd_silence(hd_core_t *core);

/* The host's message types that are understood, one bit each. */
uint32_t hd_commands(void);

/* The speed that the line should have; 0: the one that the board started with. */
uint32_t hd_line_baud(hd_core_t *core, uint32_t now_us);

/* Samples were lost, so the plate's state is unknown: zero output now, and drive again only after consecutive fresh
 * references. On a live board this counts as a dead-man trip. */
void hd_lose_samples(hd_core_t *core, uint32_t now_us);

/* Whether a model of a mode is one that a controller can be built on. */
bool hd_model_valid(const hd_mode_model_t *model);

/* At rest: nothing drives the plate until the host's next command. */
bool hd_at_rest(const hd_core_t *core);

/* Starts the prepared tool on the quiet plate. */
void hd_begin_tool(hd_core_t *core, uint32_t now_us);

/* Once what is settled is: its sums. */
void hd_memory_init(hd_core_t *core);

/* Another design: its sum starts from nothing. */
void hd_memory_restart(hd_core_t *core);

/* The next piece: what of the memory is not as it was given, if that ends a sum. */
enum hd_damage hd_memory_sweep(hd_core_t *core);

/* The fault that it is; the carrier's from the board, which looks before those ticks for which hd_sweeps_carrier. */
void hd_lose_memory(hd_core_t *core, enum hd_damage damage, uint32_t now_us);

/* What `pending` holds, the most urgent first. A newer message of a kind replaces the older, but for the two streams at
 * the end: those have rings, and wait for all others. */
enum hd_pending {
    HD_PENDING_TIME = 0x01,
    HD_PENDING_HELLO = 0x02,
    HD_PENDING_STATUS = 0x04,
    HD_PENDING_VERDICT = 0x08,
    HD_PENDING_CONTROLLER = 0x10,
    HD_PENDING_LOG = 0x20,
    HD_PENDING_SWEEP_POINT = 0x40,
    HD_PENDING_TELEMETRY = 0x80,
};

#endif
