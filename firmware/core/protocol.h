/* The messages between host and board: the one place where they are written (firmware/PROTOCOL.md is their text).
 *
 * A frame on the line is COBS(type, payload, CRC-16/CCITT-FALSE little endian) and the delimiter 0x00. Payloads are the
 * packed structures below, little endian, so a received payload is copied into its structure and needs no parsing.
 * HELLO and STATUS grow at their ends and new types are added without another version; whatever else changes takes one.
 *
 * `make -C firmware protocol` makes hapticd/board_protocol.py, the tables of firmware/PROTOCOL.md and the hash below from
 * this file, and reads its comments too: in messages, fields and enumerators they are for people, and
 *   LOW .. HIGH    in a field's are its bounds, ends included (of the magnitude, where a d and a q follow each other);
 *   enum hd_...    in a field's names what its number means;
 *   "the sweep":   begins the text of a command that a VERDICT answers: what a refusal calls it;
 *   a first sentence that a second one follows is what the host shows of a fault, a state or an event.
 */
#ifndef HD_PROTOCOL_H
#define HD_PROTOCOL_H

#include <stdint.h>

#define HD_PROTOCOL_VERSION 2
/* CRC-32 of this file without comments, this line and space. */
#define HD_PROTOCOL_HASH 0x19c239d2u

#ifndef HD_MODES
#define HD_MODES 2
#endif

#define HD_KNOTS_MAX 24
#define HD_KNOT_UNIT_US 4     /* 16 bits reach 262 ms; half a unit moves a reference of 4 um and 15 Hz by 0.8 nm */
#define HD_AHEAD_US 1000000   /* a later t_apply is a clock error, not a plan */
#define HD_STALE_US 50000     /* an earlier t_apply is what a stalled link had buffered */
#define HD_DEADMAN_US 50000   /* silence after which the board trusts the host no longer */
#define HD_REFERENCE_AGE_US 10000000 /* after which keep-alives no longer hold a reference that moves the plate */
#define HD_SATURATED_US 100000000 /* at the voltage limit, without a tick at which it sufficed */
#define HD_REARM_FRAMES 3     /* good references in a row before it trusts again */
#define HD_RAMP_US 10000      /* from full drive to none, and back */
#define HD_STATUS_US 100000   /* longest time between two STATUS messages */
#define HD_PULSE_US 5000      /* of the sync output */
#define HD_PULSE_EVERY_US 20000 /* earlier ones are left out */

#define HD_BAUD_MIN 9600
#define HD_BAUD_HOLD_US 1200000 /* without a valid frame: back to the speed that the board started with */

#define HD_REFERENCE_PULSE 0x80 /* in `knots`: a pulse when it takes effect */

#define HD_BANDWIDTH_MIN_1_S 10.0f
#define HD_BANDWIDTH_MAX_1_S 20000.0f
#define HD_INTEGRAL_TIME_MIN_S 0.0001f
#define HD_INTEGRAL_TIME_MAX_S 1.0f

/* Bounds of a mode's model. */
#define HD_DECAY_MIN_1_S 1.0f
#define HD_DECAY_MAX_1_S 10000.0f
#define HD_DETUNING_MAX_RAD_S 20000.0f
#define HD_GAIN_MIN_UM_PER_V_S 0.001f
#define HD_GAIN_MAX_UM_PER_V_S 10000.0f
#define HD_LOOP_TOLERANCE 0.001f /* of the loop phasor's magnitude, before it is made exactly 1 */

/* Bounds of the wiring's elements. */
#define HD_DRIVE_SHARE_MAX 10.0f
#define HD_SENSE_MAX 100.0f
#define HD_FEEDTHROUGH_MAX_UM_PER_V 1.0f

/* Bring-up tools: what a person may ask of a quiet board. */
#define HD_RAW_LIMIT_FRAC 0.2f      /* of the voltage limit: open loop, nothing else holds the amplitude */
#define HD_RAW_MAX_MS 1000
#define HD_SWEEP_POINTS_MAX 2001
#define HD_SWEEP_DWELL_MIN_MS 1
#define HD_SWEEP_DWELL_MAX_MS 1000
#define HD_SWEEP_OFFSET_MAX_HZ 2000.0f /* from the drive frequency */
#define HD_LOG_ENTRIES 8

/* The drive. */
#define HD_DRIVE_MOVE_MAX_HZ 2000.0f /* from the one that the board started with */
#define HD_FOLLOW_HZ 120.0f          /* how far it follows the plate, unless SET_DRIVE says otherwise */
#define HD_FOLLOW_MAX_HZ 500.0f

enum hd_message {
    HD_MSG_HELLO_REQUEST = 0x01,
        /* request the board's identity. It zeroes its output and discards earlier frames: a new session */
    HD_MSG_REFERENCE = 0x02, /* a polyline in time of the modes' amplitudes */
    HD_MSG_KEEPALIVE = 0x03, /* reset the dead-man timer. Reference `seq` stays valid */
    HD_MSG_TIME_REQUEST = 0x04, /* request the board's clock. The answer repeats the stamp */
    HD_MSG_CLEAR_FAULT = 0x05, /* leave a latched fault */
    HD_MSG_SET_CONTROLLER = 0x06, /* "the control law or its gains": select the control law and its gains */
    HD_MSG_SET_MODEL = 0x07, /* "the calibration of a mode": set the model by which the board controls one mode */
    HD_MSG_CONTROLLER_REQUEST = 0x08, /* request the active law, gains and mode models */
    HD_MSG_SWEEP = 0x09,
        /* "the sweep": drive one mode open loop with `voltage_v` at `points` frequencies, for `dwell_ms` each */
    HD_MSG_RAW_VOLTAGE = 0x0A,
        /* "the raw voltage": apply a voltage to one amplifier, open loop. Repeating the command extends it */
    HD_MSG_SET_TELEMETRY = 0x0B, /* "the telemetry": stream samples of the control tick, at most `rate_hz` a second */
    HD_MSG_LOG_REQUEST = 0x0C, /* request the cause of the last reset and the event log */
    HD_MSG_STOP = 0x0D, /* "to stop": stop a sweep or raw voltage. The voltage ramps down */
    HD_MSG_SET_WIRING = 0x0E,
        /* "the calibration of the wiring": set all wires at once, for no part makes sense without the others */
    HD_MSG_SET_DRIVE = 0x0F,
        /* "the drive": set the drive, and how far it follows the plate to either side. The modes stay at their
         * frequencies */
    HD_MSG_SET_BAUD = 0x10,
        /* "the speed of the line": set the line's speed, from the answer on. A board that then receives nothing valid for
         * HD_BAUD_HOLD_US returns to its first one */
    HD_MSG_HELLO = 0x81, /* the board's identity, rates and limits */
    HD_MSG_STATUS = 0x82, /* sent after each reference that takes effect, and ten times a second otherwise */
    HD_MSG_TIME = 0x83, /* answer to a time request: the host's stamp, and the board's clock at receipt and at reply */
    HD_MSG_CONTROLLER = 0x84, /* the active control law, its gains and models */
    HD_MSG_SWEEP_POINT = 0x85, /* mean amplitudes of all modes at one frequency of a sweep */
    HD_MSG_TELEMETRY = 0x86, /* one control tick */
    HD_MSG_LOG = 0x87, /* the cause of the last reset, and the newest of the `events` ever logged, oldest first */
    HD_MSG_VERDICT = 0x88, /* the board's answer to the command of message type `request` */
};

enum hd_verdict {
    HD_VERDICT_DONE = 0, /* done */
    HD_VERDICT_OUT_OF_RANGE = 1, /* a value is out of range */
    HD_VERDICT_NOT_QUIET = 2, /* it is busy or has a fault */
};

enum hd_state {
    HD_STATE_QUIET = 0, /* quiet. No trusted host: the output is zero, or ramping to zero */
    HD_STATE_LIVE = 1, /* live: it follows references */
    HD_STATE_FAULT = 2, /* fault. Latched: no output until CLEAR_FAULT */
    HD_STATE_TOOL = 3, /* busy with a sweep or a raw voltage. It drives the plate */
};

enum hd_fault {
    HD_FAULT_NONE = 0, /* none */
    HD_FAULT_MEASUREMENT_NOT_FINITE = 1, /* a measurement was not finite */
    HD_FAULT_CONTROL_NOT_FINITE = 2, /* a control voltage was not finite */
    HD_FAULT_OVER_AMPLITUDE = 3,
        /* the measured amplitude stayed far above its limit. A mode was measured above 1.5 times its limit in all
         * its turns of 8 ticks */
    HD_FAULT_NO_RESPONSE = 4,
        /* the sensors do not answer the drive. For 50 ms above half the voltage limit, and a sensor below a tenth of
         * what the reference should show it */
    HD_FAULT_REPEATED_DEADMAN = 5,
        /* dead-man timeout three times within ten seconds. Only if the board is configured to latch them */
    HD_FAULT_CONFIG = 6, /* the board's configuration is invalid. It cannot be cleared */
    HD_FAULT_ASTRAY = 7,
        /* the sensors do not follow the drive: a wrong phase or gain. For 50 ms above half the voltage limit, and
         * farther from the reference than 1.5 times that and a twentieth of the amplitude limit; or an observer that
         * is off by three tenths of a tick at full voltage on more than two ticks of five */
    HD_FAULT_WIRING = 8,
        /* the plate moves against its drive: wires of amplifiers or sensors are swapped or inverted, and `hapticd
         * calibrate resonance` says which. Faults 3 or 7 of a mode that moved against its drive for 10 ms */
    HD_FAULT_CLIPPED = 9,
        /* a sensor's converter is at its rails: its bias is off, or its range too small. Its samples met a rail for
         * 50 ms: mean and amplitude over a tick together reach beyond it */
    HD_FAULT_SATURATED = 10,
        /* the amplifiers were at their limit for 100 s without reaching the reference. No tick at which the voltage
         * limit sufficed for it */
    HD_FAULT_MEMORY = 11,
        /* a bit of the board's memory changed by itself: reset the board. It cannot be cleared. `value` in the log is
         * 1 a limit, 2 a reference, 3 the controller's design or the configuration, 4 the sine table, 5 the carrier */
};

enum hd_event {
    HD_EVENT_DEADMAN_TRIP = 64, /* dead-man timeout: the drive was ramped down */
    HD_EVENT_TOOL_STOPPED = 65,
        /* dead-man timeout: a sweep or raw voltage was stopped. `value` is its voltage; what a fault stops is logged
         * as that fault */
    HD_EVENT_MISSED_CHUNK = 66,
        /* samples were lost. `value` counts such events since the reset, a series is one entry */
    HD_EVENT_SLOW_CLOCK = 67, /* the crystal did not start: the board does not drive. It communicates */
    HD_EVENT_CRASH = 68, /* the program crashed. `value` is the place in the program, from the beginning of the flash */
};

enum hd_reset_cause {
    HD_RESET_UNKNOWN = 0, /* unknown */
    HD_RESET_POWER = 1, /* power-up */
    HD_RESET_PIN = 2, /* reset pin */
    HD_RESET_SOFTWARE = 3, /* software */
    HD_RESET_WATCHDOG = 4, /* watchdog */
    HD_RESET_BROWN_OUT = 5, /* brown-out */
    HD_RESET_LOW_POWER = 6, /* low-power management */
};

enum hd_law {
    HD_LAW_PI = 0, /* the paper's four PI controllers */
    HD_LAW_PI_FF = 1, /* coupling compensation and feed-forward added */
    HD_LAW_DEADBEAT = 2, /* deadbeat with an observer */
};

enum hd_status_flag {
    HD_STATUS_APPLIED = 0x01, /* reference `seq` has taken effect, at `t_applied_us` */
    HD_STATUS_SATURATED = 0x02, /* the amplifiers were at their limit */
    HD_STATUS_LIMITED = 0x04, /* a reference was scaled down */
    HD_STATUS_PULSED = 0x08, /* the sync output rose */
};

enum hd_refusal {
    HD_REFUSAL_NONE = 0, /* none was refused */
    HD_REFUSAL_MALFORMED = 1,
        /* its length, modes, knots or values are not valid. Offsets rise, and values are finite */
    HD_REFUSAL_AHEAD = 2, /* it begins more than 1 s from now */
    HD_REFUSAL_STALE = 3, /* it began more than 50 ms ago */
    HD_REFUSAL_ORDER = 4, /* it is not newer than the last one taken */
    HD_REFUSAL_TOOL = 5, /* a sweep or a raw voltage drives the plate */
};

enum hd_feature {
    HD_FEATURE_SYNC = 0x01, /* a sync output */
};

#define HD_PACKED __attribute__((packed))

/* --- host to board; messages without a structure have no payload --- */

typedef struct HD_PACKED {
    float d_um;
    float q_um;
} hd_wire_phasor_t;

typedef struct HD_PACKED {
    uint16_t offset;
    hd_wire_phasor_t modal[HD_MODES];
} hd_wire_knot_t;

typedef struct HD_PACKED {
    uint16_t seq;
    uint32_t t_apply_us;
    uint8_t knots; /* and HD_REFERENCE_PULSE */
    uint8_t modes;
} hd_wire_reference_t;

typedef struct HD_PACKED {
    uint16_t seq;
} hd_wire_keepalive_t;

typedef struct HD_PACKED {
    uint64_t t_host_ns;
} hd_wire_time_request_t;

typedef struct HD_PACKED {
    uint8_t law;           /* enum hd_law */
    float bandwidth_1_s;   /* HD_BANDWIDTH_MIN_1_S .. HD_BANDWIDTH_MAX_1_S, or 0: the firmware's own */
    float integral_time_s; /* HD_INTEGRAL_TIME_MIN_S .. HD_INTEGRAL_TIME_MAX_S, or 0 */
} hd_wire_set_controller_t;

/* (loop_d, loop_q) is the unit phasor of the constant phase that amplifier, electrodes and sensor add to the loop. */
typedef struct HD_PACKED {
    float decay_1_s;       /* HD_DECAY_MIN_1_S .. HD_DECAY_MAX_1_S */
    float detuning_rad_s;  /* from the drive: -HD_DETUNING_MAX_RAD_S .. HD_DETUNING_MAX_RAD_S */
    float gain_um_per_v_s; /* HD_GAIN_MIN_UM_PER_V_S .. HD_GAIN_MAX_UM_PER_V_S */
    float loop_d; /* 0.9995 .. 1.0005 */
    float loop_q;
} hd_wire_model_t;

typedef struct HD_PACKED {
    uint8_t mode; /* 0 .. 254 */
    hd_wire_model_t model;
} hd_wire_set_model_t;

typedef struct HD_PACKED {
    float drive[HD_MODES * HD_MODES];                  /* row by row: of amplifier k, by mode p; -HD_DRIVE_SHARE_MAX .. HD_DRIVE_SHARE_MAX */
    hd_wire_phasor_t sense[HD_MODES * HD_MODES];       /* of mode p, by sensor s; 0 .. HD_SENSE_MAX */
    hd_wire_phasor_t feedthrough[HD_MODES * HD_MODES]; /* um per V: of mode p, by amplifier k; 0 .. HD_FEEDTHROUGH_MAX_UM_PER_V */
} hd_wire_set_wiring_t;

typedef struct HD_PACKED {
    float drive_hz;  /* 1 .. 1e6, and within HD_DRIVE_MOVE_MAX_HZ of the one that the board started with */
    float follow_hz; /* to either side: 0 .. HD_FOLLOW_MAX_HZ; 0: not at all */
} hd_wire_set_drive_t;

typedef struct HD_PACKED {
    uint32_t baud; /* HD_BAUD_MIN .. 10000000, and at most the `baud_max` of HELLO */
} hd_wire_set_baud_t;

typedef struct HD_PACKED {
    uint8_t mode;      /* of the driven amplifier: 0 .. 254 */
    float start_hz;    /* 1 .. 1e6, and within HD_SWEEP_OFFSET_MAX_HZ of the drive */
    float stop_hz;     /* 1 .. 1e6, likewise */
    uint16_t points;   /* 1 .. HD_SWEEP_POINTS_MAX */
    uint16_t dwell_ms; /* at each point: HD_SWEEP_DWELL_MIN_MS .. HD_SWEEP_DWELL_MAX_MS; the second half is averaged */
    float voltage_v;   /* 1e-3 .. 1e4, and at most HD_RAW_LIMIT_FRAC of the voltage limit */
} hd_wire_sweep_t;

typedef struct HD_PACKED {
    uint8_t mode;         /* of the driven amplifier: 0 .. 254 */
    float voltage_d_v;    /* 0 .. 1e4, and at most HD_RAW_LIMIT_FRAC of the voltage limit */
    float voltage_q_v;
    uint16_t duration_ms; /* 1 .. HD_RAW_MAX_MS */
} hd_wire_raw_voltage_t;

typedef struct HD_PACKED {
    uint16_t rate_hz; /* 0 .. 65535; 0 ends the stream */
} hd_wire_set_telemetry_t;

/* --- board to host --- */

typedef struct HD_PACKED {
    uint16_t protocol_version;
    uint32_t protocol_hash;
    uint8_t modes; /* 1 .. 255 */
    uint8_t firmware_version[16];
    uint32_t boot_id;
    float control_hz;   /* 500 .. 50000 */
    float drive_hz;     /* that was set last: 1 .. 1e6 */
    uint16_t deadman_ms; /* 50 .. 50 */
    float v_limit_v;    /* 1e-6 .. 1e6 */
    float w_limit_um[HD_MODES];
    uint32_t image_crc; /* of the flashed program, CRC-32; 0 of a board that has none */
    uint32_t baud_max;  /* for SET_BAUD; 0: it has one speed */
    uint8_t features;   /* enum hd_feature */
    uint32_t commands;  /* bit n: message type n of the host is understood */
} hd_wire_hello_t;

typedef struct HD_PACKED {
    float measured_d_um;
    float measured_q_um;
    float voltage_d_v;
    float voltage_q_v;
} hd_wire_mode_t;

typedef struct HD_PACKED {
    uint32_t t_board_us;
    uint8_t state;
    uint8_t flags;
    uint8_t fault_code;
    uint8_t modes;
    uint16_t seq;
    uint32_t t_received_us;
    uint32_t t_applied_us;
    uint16_t deadman_trips;
    uint32_t bad_frames;
    uint32_t late_frames;
    hd_wire_mode_t mode[HD_MODES];
    float drive_hz;
    uint16_t number;      /* of this STATUS since the reset: a gap shows the flags of how many were lost */
    uint16_t refused_seq; /* the last REFERENCE of this session that was not taken */
    uint8_t refusal;      /* enum hd_refusal: why */
    uint64_t holdable;    /* byte k: the share of mode k's W_LIM that the voltage holds now, of 255; all 0: unknown */
} hd_wire_status_t;

typedef struct HD_PACKED {
    uint64_t t_host_ns;
    uint32_t t_received_us;
    uint32_t t_sent_us;
} hd_wire_time_t;

typedef struct HD_PACKED {
    uint8_t law;
    float bandwidth_1_s;
    float integral_time_s;
    uint8_t modes;
    hd_wire_model_t model[HD_MODES];
} hd_wire_controller_t;

typedef struct HD_PACKED {
    uint16_t index;
    uint16_t points;
    uint8_t mode; /* the driven amplifier, which gets `voltage_v` on the d axis; the values are the sensors' own */
    uint8_t modes;
    float frequency_hz;
    float voltage_v;
    hd_wire_phasor_t measured[HD_MODES];
} hd_wire_sweep_point_t;

typedef struct HD_PACKED {
    hd_wire_phasor_t reference;
    hd_wire_mode_t now;
    float decay_1_s; /* the observer's estimates */
    float detuning_rad_s;
} hd_wire_telemetry_mode_t;

typedef struct HD_PACKED {
    uint32_t t_board_us; /* the control tick */
    uint32_t dropped;    /* samples of this stream that the line had no room for before this one */
    uint8_t state;
    uint8_t flags; /* enum hd_status_flag, of this tick alone */
    uint8_t modes;
    hd_wire_telemetry_mode_t mode[HD_MODES];
} hd_wire_telemetry_t;

typedef struct HD_PACKED {
    uint32_t t_board_us;
    uint32_t boot_id;
    uint8_t code; /* enum hd_fault or hd_event */
    uint8_t mode; /* the one concerned, 255 for none */
    float value;  /* the measurement, where there is one */
} hd_wire_log_entry_t;

/* Oldest first; entries of earlier boots survive a reset that keeps the memory. Unused entries are zero. */
typedef struct HD_PACKED {
    uint8_t reset_cause;
    uint8_t entries;
    uint32_t events; /* ever logged */
    hd_wire_log_entry_t entry[HD_LOG_ENTRIES];
} hd_wire_log_t;

typedef struct HD_PACKED {
    uint8_t request; /* the message type answered */
    uint8_t verdict; /* enum hd_verdict */
} hd_wire_verdict_t;

#define HD_REFERENCE_MAX (sizeof(hd_wire_reference_t) + HD_KNOTS_MAX * sizeof(hd_wire_knot_t))
#define HD_FRAME_MAX (1 + HD_REFERENCE_MAX + 2)                 /* type, payload, CRC */
#define HD_LINE_SIZE(frame) ((frame) + (frame) / 254 + 2)       /* COBS codes and the delimiter */

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "payloads are copied as they lie in memory");
_Static_assert(sizeof(hd_wire_reference_t) == 8, "a hole in REFERENCE");
_Static_assert(sizeof(hd_wire_knot_t) == 2 + 8 * HD_MODES, "a hole in a knot");
_Static_assert(sizeof(hd_wire_hello_t) == 54 + 4 * HD_MODES, "a hole in HELLO");
_Static_assert(sizeof(hd_wire_status_t) == 45 + 16 * HD_MODES, "a hole in STATUS");
_Static_assert(sizeof(hd_wire_time_t) == 16, "a hole in TIME");
_Static_assert(sizeof(hd_wire_set_model_t) == 21, "a hole in SET_MODEL");
_Static_assert(sizeof(hd_wire_set_wiring_t) == 20 * HD_MODES * HD_MODES, "a hole in SET_WIRING");
_Static_assert(sizeof(hd_wire_set_drive_t) == 8, "a hole in SET_DRIVE");
_Static_assert(sizeof(hd_wire_sweep_t) == 17, "a hole in SWEEP");
_Static_assert(sizeof(hd_wire_raw_voltage_t) == 11, "a hole in RAW_VOLTAGE");
_Static_assert(sizeof(hd_wire_controller_t) == 10 + 20 * HD_MODES, "a hole in CONTROLLER");
_Static_assert(sizeof(hd_wire_sweep_point_t) == 14 + 8 * HD_MODES, "a hole in SWEEP_POINT");
_Static_assert(sizeof(hd_wire_telemetry_t) == 11 + 32 * HD_MODES, "a hole in TELEMETRY");
_Static_assert(sizeof(hd_wire_log_t) == 6 + 14 * HD_LOG_ENTRIES, "a hole in LOG");
_Static_assert(sizeof(hd_wire_verdict_t) == 2, "a hole in VERDICT");

#endif
