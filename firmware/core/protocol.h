/* What travels between host and board: the one source of truth for every byte (firmware/PROTOCOL.md is its text).
 *
 * A frame on the line is COBS(type, payload, CRC-16/CCITT-FALSE little endian) and the delimiter 0x00. Payloads are the
 * packed structures below, little endian, so a received payload is copied into its structure and needs no parsing.
 * The host holds the same layouts; a test reads this file and compares. HELLO may only ever grow at its end, so that
 * any host can read the version of any board.
 */
#ifndef HD_PROTOCOL_H
#define HD_PROTOCOL_H

#include <stdint.h>

#define HD_PROTOCOL_VERSION 1
/* CRC-32 of this file without comments, this line and space; tests/firmware/test_protocol_header.py computes it. */
#define HD_PROTOCOL_HASH 0xd5f8fdf5u

#ifndef HD_MODES
#define HD_MODES 2
#endif

#define HD_KNOTS_MAX 24
#define HD_KNOT_UNIT_US 4     /* 16 bits reach 262 ms; half a unit moves a reference of 4 um and 15 Hz by 0.8 nm */
#define HD_AHEAD_US 1000000   /* a later t_apply is a clock error, not a plan */
#define HD_STALE_US 50000     /* an earlier t_apply is what a stalled link had buffered */
#define HD_DEADMAN_US 50000   /* silence after which the board trusts the host no longer */
#define HD_REARM_FRAMES 3     /* good references in a row before it trusts again */
#define HD_RAMP_US 10000      /* from full drive to none, and back */
#define HD_STATUS_US 100000   /* longest time between two STATUS messages */

#define HD_BANDWIDTH_MIN_1_S 10.0f
#define HD_BANDWIDTH_MAX_1_S 2000.0f
#define HD_INTEGRAL_TIME_MIN_S 0.0005f
#define HD_INTEGRAL_TIME_MAX_S 1.0f

enum hd_message {
    HD_MSG_HELLO_REQUEST = 0x01,
    HD_MSG_REFERENCE = 0x02,
    HD_MSG_KEEPALIVE = 0x03,
    HD_MSG_TIME_REQUEST = 0x04,
    HD_MSG_CLEAR_FAULT = 0x05,
    HD_MSG_SET_CONTROLLER = 0x06,
    HD_MSG_HELLO = 0x81,
    HD_MSG_STATUS = 0x82,
    HD_MSG_TIME = 0x83,
};

enum hd_state {
    HD_STATE_QUIET = 0,
    HD_STATE_LIVE = 1,
    HD_STATE_FAULT = 2,
};

enum hd_fault {
    HD_FAULT_NONE = 0,
    HD_FAULT_MEASUREMENT_NOT_FINITE = 1,
    HD_FAULT_CONTROL_NOT_FINITE = 2,
    HD_FAULT_OVER_AMPLITUDE = 3,
    HD_FAULT_NO_RESPONSE = 4,
    HD_FAULT_REPEATED_DEADMAN = 5,
    HD_FAULT_CONFIG = 6, /* cannot be cleared */
};

enum hd_law {
    HD_LAW_PI = 0,
    HD_LAW_PI_FF = 1,
};

enum hd_status_flag {
    HD_STATUS_APPLIED = 0x01,
    HD_STATUS_SATURATED = 0x02,
    HD_STATUS_LIMITED = 0x04,
};

#define HD_PACKED __attribute__((packed))

/* --- host to board; HELLO_REQUEST and CLEAR_FAULT have no payload --- */

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
    uint8_t knots;
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
} hd_wire_status_t;

typedef struct HD_PACKED {
    uint64_t t_host_ns;
    uint32_t t_received_us;
    uint32_t t_sent_us;
} hd_wire_time_t;

#define HD_REFERENCE_MAX (sizeof(hd_wire_reference_t) + HD_KNOTS_MAX * sizeof(hd_wire_knot_t))
#define HD_FRAME_MAX (1 + HD_REFERENCE_MAX + 2)                 /* type, payload, CRC */
#define HD_LINE_SIZE(frame) ((frame) + (frame) / 254 + 2)       /* COBS codes and the delimiter */

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "payloads are copied as they lie in memory");
_Static_assert(sizeof(hd_wire_reference_t) == 8, "a hole in REFERENCE");
_Static_assert(sizeof(hd_wire_knot_t) == 2 + 8 * HD_MODES, "a hole in a knot");
_Static_assert(sizeof(hd_wire_hello_t) == 41 + 4 * HD_MODES, "a hole in HELLO");
_Static_assert(sizeof(hd_wire_status_t) == 28 + 16 * HD_MODES, "a hole in STATUS");
_Static_assert(sizeof(hd_wire_time_t) == 16, "a hole in TIME");

#endif
