/* What travels between host and board: the one source of truth for every byte (firmware/PROTOCOL.md is its text).
 *
 * A frame on the line is COBS(type, payload, CRC-16/CCITT-FALSE little endian) and the delimiter 0x00. Payloads are the
 * packed structures below, little endian, so a received payload is copied into its structure and needs no parsing.
 * The host holds the same layouts; a test reads this file and compares. HELLO and STATUS grow at their ends and new types
 * are added without another version; whatever else changes takes one.
 */
#ifndef HD_PROTOCOL_H
#define HD_PROTOCOL_H

#include <stdint.h>

#define HD_PROTOCOL_VERSION 2
/* CRC-32 of this file without comments, this line and space; tests/firmware/test_protocol_header.py computes it. */
#define HD_PROTOCOL_HASH 0x5b0a791eu

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
    HD_MSG_REFERENCE = 0x02,
    HD_MSG_KEEPALIVE = 0x03,
    HD_MSG_TIME_REQUEST = 0x04,
    HD_MSG_CLEAR_FAULT = 0x05,
    HD_MSG_SET_CONTROLLER = 0x06,
    HD_MSG_SET_MODEL = 0x07,
    HD_MSG_CONTROLLER_REQUEST = 0x08,
    HD_MSG_SWEEP = 0x09,
    HD_MSG_RAW_VOLTAGE = 0x0A,
    HD_MSG_SET_TELEMETRY = 0x0B,
    HD_MSG_LOG_REQUEST = 0x0C,
    HD_MSG_STOP = 0x0D,
    HD_MSG_SET_WIRING = 0x0E,
    HD_MSG_SET_DRIVE = 0x0F,
    HD_MSG_SET_BAUD = 0x10,
    HD_MSG_HELLO = 0x81,
    HD_MSG_STATUS = 0x82,
    HD_MSG_TIME = 0x83,
    HD_MSG_CONTROLLER = 0x84,
    HD_MSG_SWEEP_POINT = 0x85,
    HD_MSG_TELEMETRY = 0x86,
    HD_MSG_LOG = 0x87,
    HD_MSG_VERDICT = 0x88,
};

/* Result of a command in a VERDICT. */
enum hd_verdict {
    HD_VERDICT_DONE = 0,
    HD_VERDICT_OUT_OF_RANGE = 1,
    HD_VERDICT_NOT_QUIET = 2, /* the board does something else, or has a fault */
};

enum hd_state {
    HD_STATE_QUIET = 0,
    HD_STATE_LIVE = 1,
    HD_STATE_FAULT = 2,
    HD_STATE_TOOL = 3, /* a sweep or a raw voltage drives the plate */
};

enum hd_fault {
    HD_FAULT_NONE = 0,
    HD_FAULT_MEASUREMENT_NOT_FINITE = 1,
    HD_FAULT_CONTROL_NOT_FINITE = 2,
    HD_FAULT_OVER_AMPLITUDE = 3,
    HD_FAULT_NO_RESPONSE = 4,
    HD_FAULT_REPEATED_DEADMAN = 5,
    HD_FAULT_CONFIG = 6, /* cannot be cleared */
    HD_FAULT_ASTRAY = 7, /* the measurement is not what the drive does */
    HD_FAULT_WIRING = 8, /* the same, and a mode moves against its drive */
    HD_FAULT_CLIPPED = 9, /* a sensor's converter is at its rails */
    HD_FAULT_SATURATED = 10, /* the voltage limit keeps the plate from its reference for too long */
};

/* Log events other than faults. */
enum hd_event {
    HD_EVENT_DEADMAN_TRIP = 64,
    HD_EVENT_TOOL_STOPPED = 65, /* by the dead-man; what a fault stops is logged as that fault */
    HD_EVENT_MISSED_CHUNK = 66, /* samples were lost; `value` counts such events since the reset */
    HD_EVENT_SLOW_CLOCK = 67,   /* the crystal does not start: the board communicates but does not drive */
    HD_EVENT_CRASH = 68,        /* `value` is the place in the program, from the beginning of the flash */
};

enum hd_reset_cause {
    HD_RESET_UNKNOWN = 0,
    HD_RESET_POWER = 1,
    HD_RESET_PIN = 2,
    HD_RESET_SOFTWARE = 3,
    HD_RESET_WATCHDOG = 4,
    HD_RESET_BROWN_OUT = 5,
    HD_RESET_LOW_POWER = 6,
};

enum hd_law {
    HD_LAW_PI = 0,
    HD_LAW_PI_FF = 1,
    HD_LAW_DEADBEAT = 2,
};

enum hd_status_flag {
    HD_STATUS_APPLIED = 0x01,
    HD_STATUS_SATURATED = 0x02,
    HD_STATUS_LIMITED = 0x04,
    HD_STATUS_PULSED = 0x08, /* the sync output rose with it */
};

/* Why a REFERENCE was not taken. */
enum hd_refusal {
    HD_REFUSAL_NONE = 0,
    HD_REFUSAL_MALFORMED = 1, /* length, number of modes or knots, offsets that do not rise, a value that is not finite */
    HD_REFUSAL_AHEAD = 2,     /* it begins more than HD_AHEAD_US from now */
    HD_REFUSAL_STALE = 3,     /* it began more than HD_STALE_US ago */
    HD_REFUSAL_ORDER = 4,     /* it is not newer than the last one taken */
    HD_REFUSAL_TOOL = 5,      /* a tool drives the plate */
};

enum hd_feature {
    HD_FEATURE_SYNC = 0x01, /* a sync output */
};

#define HD_PACKED __attribute__((packed))

/* --- host to board; HELLO_REQUEST, CLEAR_FAULT, CONTROLLER_REQUEST, LOG_REQUEST and STOP have no payload --- */

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
    uint8_t law;
    float bandwidth_1_s;
    float integral_time_s;
} hd_wire_set_controller_t;

/* (loop_d, loop_q) is the unit phasor of the constant phase that amplifier, electrodes and sensor add to the loop. */
typedef struct HD_PACKED {
    float decay_1_s;
    float detuning_rad_s;
    float gain_um_per_v_s;
    float loop_d;
    float loop_q;
} hd_wire_model_t;

typedef struct HD_PACKED {
    uint8_t mode;
    hd_wire_model_t model;
} hd_wire_set_model_t;

/* All of it at once: no part makes sense without the others. */
typedef struct HD_PACKED {
    float drive[HD_MODES * HD_MODES];                  /* row by row: of amplifier k, by mode p */
    hd_wire_phasor_t sense[HD_MODES * HD_MODES];       /* of mode p, by sensor s */
    hd_wire_phasor_t feedthrough[HD_MODES * HD_MODES]; /* um per V: of mode p, by amplifier k */
} hd_wire_set_wiring_t;

typedef struct HD_PACKED {
    float drive_hz;
    float follow_hz; /* how far it follows the plate, to either side; 0: not at all */
} hd_wire_set_drive_t;

/* From when its VERDICT has been sent, and until no valid frame has come for HD_BAUD_HOLD_US. */
typedef struct HD_PACKED {
    uint32_t baud;
} hd_wire_set_baud_t;

typedef struct HD_PACKED {
    uint8_t mode;
    float start_hz;
    float stop_hz;
    uint16_t points;
    uint16_t dwell_ms; /* at each point; the second half of it is averaged */
    float voltage_v;
} hd_wire_sweep_t;

typedef struct HD_PACKED {
    uint8_t mode;
    float voltage_d_v;
    float voltage_q_v;
    uint16_t duration_ms;
} hd_wire_raw_voltage_t;

typedef struct HD_PACKED {
    uint16_t rate_hz; /* 0 ends the stream */
} hd_wire_set_telemetry_t;

/* --- board to host --- */

typedef struct HD_PACKED {
    uint16_t protocol_version;
    uint32_t protocol_hash;
    uint8_t modes;
    uint8_t firmware_version[16];
    uint32_t boot_id;
    float control_hz;
    float drive_hz;
    uint16_t deadman_ms;
    float v_limit_v;
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
_Static_assert(sizeof(hd_wire_status_t) == 37 + 16 * HD_MODES, "a hole in STATUS");
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
