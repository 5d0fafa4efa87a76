/* Client of hapticd in C99 over libzmq (4.x): link hapticd.c and -lzmq. For one thread per client;
 * program.c is an example.
 *
 * What was set holds for the time to live, 0.5 s: each hapticd_read and hapticd_refresh repeats it when it is due, so
 * call one of them ten times a second. Messages are those of clients/PROTOCOL.md; positions are in mm from the plate's
 * centre, amplitudes in um peak to peak, angles in rad anticlockwise.
 */
#ifndef HAPTICD_H
#define HAPTICD_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    HAPTICD_OK = 0,
    HAPTICD_REFUSED = 1, /* by the daemon, or here for a bad argument: nothing has changed */
    HAPTICD_GONE = 2,    /* no daemon answers within the timeout */
    HAPTICD_MAX_FINGERS = 32,
    HAPTICD_MAX_TARGETS = 16,
    HAPTICD_MAX_SURFACES = 16
};

typedef struct hapticd hapticd;

/* One finger of a state. Numbers that the daemon has not computed are NAN. */
typedef struct {
    uint32_t id; /* 0 for a virtual finger */
    char name[129]; /* of a virtual finger, else empty */
    char owner[129]; /* the client that owns it, else empty */
    double x_mm, y_mm;
    double target_um, achieved_um;
    double felt_friction; /* 0: the most slippery .. 1: bare glass */
} hapticd_finger;

/* The plate at one instant of the daemon's clock. */
typedef struct {
    uint64_t instance; /* another one after a restart of the daemon */
    uint64_t seq;
    uint64_t t_ns;
    char state[17]; /* IDLE, ARMED, ACTIVE, FAULT or STOPPED */
    int limited;
    double age_ms;
    size_t fingers; /* how many follow; more than HAPTICD_MAX_FINGERS are left out */
    hapticd_finger finger[HAPTICD_MAX_FINGERS];
} hapticd_state;

typedef struct {
    double period_mm, high_um, low_um, angle_rad, duty_frac;
} hapticd_grating;

/* A surface: set exactly one of friction and amplitude_um, the other is NAN; at most one shape, the others are 0.
 * hapticd_new_surface() has no content, covers the whole plate and lies at the centre. */
typedef struct {
    double friction, amplitude_um;
    double circle_mm;           /* radius */
    double rectangle_mm[2];     /* width, height */
    double position_mm[2];
    double angle_rad;
    int z;
} hapticd_surface;

/* Connect to the daemon in a directory (NULL: $HAPTICD_RUNTIME_DIR, else where one is of $XDG_RUNTIME_DIR/hapticd,
 * /tmp/hapticd-UID and /run/hapticd) and greet it. Returns NULL without memory only; else ask hapticd_error.
 * `name`: 1 .. 32 printable characters, unique. */
hapticd *hapticd_open(const char *directory, const char *name, double timeout_s);

/* Release everything and disconnect. Nothing for NULL. */
void hapticd_close(hapticd *plate);

/* The sentence of the last call that failed, empty after one that did not; valid until the next call. */
const char *hapticd_error(const hapticd *plate);

/* 0.02 .. 5 s, from the next change on. */
int hapticd_set_ttl(hapticd *plate, double ttl_s);

/* Targets of a finger on the plate. Each replaces the earlier one. */
int hapticd_set_friction(hapticd *plate, uint32_t finger, double friction);
int hapticd_set_amplitude(hapticd *plate, uint32_t finger, double amplitude_um);
int hapticd_set_grating(hapticd *plate, uint32_t finger, const hapticd_grating *grating);
int hapticd_release(hapticd *plate, uint32_t finger);
/* Releases all fingers and removes all surfaces. */
int hapticd_release_all(hapticd *plate);

hapticd_surface hapticd_new_surface(void);
/* Lays content on the plate; the same name again changes it. */
int hapticd_lay_surface(hapticd *plate, const char *name, const hapticd_surface *surface);
int hapticd_remove_surface(hapticd *plate, const char *name);

/* Marks an instant in recordings; `t_ns`, unless NULL, gets it. With `pulse` the board's output rises. */
int hapticd_marker(hapticd *plate, const char *text, int pulse, uint64_t *t_ns);

/* Repeat what is set, if it is due. */
void hapticd_refresh(hapticd *plate);

/* Get the newest state that was not read yet. */
int hapticd_read(hapticd *plate, hapticd_state *state, double timeout_s);

#ifdef __cplusplus
}
#endif
#endif
