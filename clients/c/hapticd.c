#define _POSIX_C_SOURCE 200809L /* clock_gettime */
#include "hapticd.h"

#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>

enum { MAX_BYTES = 65536, ITEM_BYTES = 512, NAME_BYTES = 129, ERROR_BYTES = 512, MAX_DEPTH = 16, REFRESHES = 3 };

/* An item of a targets message: its key, and the map as it is sent. */
typedef struct {
    uint32_t finger;
    char name[NAME_BYTES];
    bool was_down; /* in a state that was read */
    size_t length;
    uint8_t bytes[ITEM_BYTES];
} item;

typedef struct {
    size_t count;
    item items[HAPTICD_MAX_TARGETS];
} item_list;

struct hapticd {
    void *context, *targets, *control, *telemetry;
    char directory[256];
    char name[NAME_BYTES];
    char error[ERROR_BYTES];
    double timeout_s, ttl_s;
    uint32_t request_id;
    uint64_t stamp_ns, sent_ns;
    item_list fingers, surfaces;
};

static uint64_t now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static int fails(hapticd *plate, int code, const char *format, ...) {
    va_list rest;
    va_start(rest, format);
    vsnprintf(plate->error, sizeof plate->error, format, rest);
    va_end(rest);
    return code;
}

/* --- MessagePack, written: what does not fit is not written, and `is_full` ------------------------------------- */

typedef struct {
    uint8_t *bytes;
    size_t length, size;
    bool is_full;
} writer;

static void put(writer *out, const void *bytes, size_t length) {
    if (length > out->size - out->length) {
        out->is_full = true;
        return;
    }
    memcpy(out->bytes + out->length, bytes, length);
    out->length += length;
}

static void put_head(writer *out, uint8_t type, uint64_t value, int bytes) {
    uint8_t head[9] = {type};
    for (int i = 0; i < bytes; i++) head[1 + i] = (uint8_t)(value >> (8 * (bytes - 1 - i)));
    put(out, head, (size_t)bytes + 1);
}

static void put_map(writer *out, size_t count) { put_head(out, (uint8_t)(0x80 | count), 0, 0); }

static void put_array(writer *out, size_t count) { put_head(out, 0xdc, count, 2); }

static void put_whole(writer *out, uint64_t value) { put_head(out, 0xcf, value, 8); }

static void put_signed(writer *out, int64_t value) { put_head(out, 0xd3, (uint64_t)value, 8); }

static void put_bool(writer *out, bool value) { put_head(out, value ? 0xc3 : 0xc2, 0, 0); }

static void put_text(writer *out, const char *text) {
    size_t length = strlen(text);
    put_head(out, 0xdb, length, 4);
    put(out, text, length);
}

static void put_number(writer *out, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_head(out, 0xcb, bits, 8);
}

static void put_field(writer *out, const char *name, double value) {
    put_text(out, name);
    put_number(out, value);
}

static void put_pair(writer *out, const char *name, const double pair[2]) {
    put_text(out, name);
    put_array(out, 2);
    put_number(out, pair[0]);
    put_number(out, pair[1]);
}

/* --- MessagePack, read: whatever the bytes, no read is beyond them, and `is_bad` ------------------------------- */

typedef struct {
    const uint8_t *at, *end;
    bool is_bad;
} reader;

typedef enum { KIND_NIL, KIND_BOOL, KIND_NUMBER, KIND_TEXT, KIND_ARRAY, KIND_MAP, KIND_OTHER } kind;

typedef struct {
    kind kind;
    double number;
    uint64_t whole; /* of a number without sign and fraction */
    const char *text; /* not ended by 0 */
    size_t count; /* bytes of a text or others, items of an array, pairs of a map */
} value;

static uint64_t big_endian(reader *in, size_t bytes) {
    uint64_t found = 0;
    if ((size_t)(in->end - in->at) < bytes) {
        in->is_bad = true;
        in->at = in->end;
        return 0;
    }
    for (size_t i = 0; i < bytes; i++) found = found << 8 | in->at[i];
    in->at += bytes;
    return found;
}

static value bytes_of(reader *in, kind which, uint64_t count) {
    value found = {which, NAN, 0, (const char *)in->at, (size_t)count};
    if ((uint64_t)(in->end - in->at) < count) {
        in->is_bad = true;
        in->at = in->end;
        found.count = 0;
        return found;
    }
    in->at += count;
    return found;
}

static value whole_of(uint64_t whole) {
    value found = {KIND_NUMBER, (double)whole, whole, NULL, 0};
    return found;
}

static value signed_of(uint64_t bits, int size) {
    uint64_t sign = (uint64_t)1 << (8 * size - 1);
    if (bits < sign) return whole_of(bits);
    uint64_t magnitude = (size == 8 ? 0 : sign << 1) - bits;
    value found = {KIND_NUMBER, -(double)magnitude, 0, NULL, 0};
    return found;
}

static value number_of(uint64_t bits, size_t size) {
    value found = {KIND_NUMBER, NAN, 0, NULL, 0};
    if (size == 4) {
        uint32_t half = (uint32_t)bits;
        float single;
        memcpy(&single, &half, sizeof single);
        found.number = (double)single;
    } else {
        memcpy(&found.number, &bits, sizeof bits);
    }
    return found;
}

static value plain(kind which, uint64_t count) {
    value found = {which, NAN, 0, NULL, (size_t)count};
    return found;
}

/* The next value; of arrays and maps only the head. */
static value next(reader *in) {
    uint8_t type = (uint8_t)big_endian(in, 1);
    if (in->is_bad) return plain(KIND_OTHER, 0);
    if (type < 0x80) return whole_of(type);
    if (type < 0x90) return plain(KIND_MAP, type & 0x0f);
    if (type < 0xa0) return plain(KIND_ARRAY, type & 0x0f);
    if (type < 0xc0) return bytes_of(in, KIND_TEXT, type & 0x1f);
    if (type >= 0xe0) return signed_of(type, 1);
    switch (type) {
    case 0xc0: return plain(KIND_NIL, 0);
    case 0xc2: return plain(KIND_BOOL, 0);
    case 0xc3: return plain(KIND_BOOL, 1);
    case 0xc4: case 0xc5: case 0xc6: return bytes_of(in, KIND_OTHER, big_endian(in, (size_t)1 << (type - 0xc4)));
    case 0xca: return number_of(big_endian(in, 4), 4);
    case 0xcb: return number_of(big_endian(in, 8), 8);
    case 0xcc: case 0xcd: case 0xce: case 0xcf: return whole_of(big_endian(in, (size_t)1 << (type - 0xcc)));
    case 0xd0: case 0xd1: case 0xd2: case 0xd3: {
        int size = 1 << (type - 0xd0);
        return signed_of(big_endian(in, (size_t)size), size);
    }
    case 0xd9: case 0xda: case 0xdb: return bytes_of(in, KIND_TEXT, big_endian(in, (size_t)1 << (type - 0xd9)));
    case 0xdc: case 0xdd: return plain(KIND_ARRAY, big_endian(in, (size_t)2 << (type - 0xdc)));
    case 0xde: case 0xdf: return plain(KIND_MAP, big_endian(in, (size_t)2 << (type - 0xde)));
    default: in->is_bad = true; return plain(KIND_OTHER, 0); /* no extension is sent */
    }
}

/* Pass over what is in a value whose head was read. Each item takes a byte, so a false count ends with the bytes. */
static void skip(reader *in, value head, int depth) {
    if (head.kind != KIND_ARRAY && head.kind != KIND_MAP) return;
    if (depth >= MAX_DEPTH) {
        in->is_bad = true;
        return;
    }
    for (size_t i = 0; i < head.count && !in->is_bad; i++) {
        for (int part = head.kind == KIND_MAP ? 0 : 1; part < 2; part++) skip(in, next(in), depth + 1);
    }
}

static bool is_text(value one, const char *text) {
    return one.kind == KIND_TEXT && one.count == strlen(text) && memcmp(one.text, text, one.count) == 0;
}

static void copy_text(char *into, size_t size, value one) {
    size_t length = one.kind == KIND_TEXT ? (one.count < size - 1 ? one.count : size - 1) : 0;
    if (length > 0) memcpy(into, one.text, length);
    into[length] = 0;
}

/* --- messages --------------------------------------------------------------------------------------------------- */

static void put_items(writer *out, const char *name, const item_list *list) {
    put_text(out, name);
    put_array(out, list->count);
    for (size_t i = 0; i < list->count; i++) put(out, list->items[i].bytes, list->items[i].length);
}

static void put_targets(const hapticd *plate, writer *out, bool has_version) {
    put_map(out, has_version ? 6 : 5);
    if (has_version) {
        put_text(out, "v");
        put_whole(out, 1);
    }
    put_text(out, "client");
    put_text(out, plate->name);
    put_field(out, "ttl_s", plate->ttl_s);
    put_text(out, "stamp");
    put_whole(out, plate->stamp_ns);
    put_items(out, "targets", &plate->fingers);
    put_items(out, "surfaces", &plate->surfaces);
}

static void new_stamp(hapticd *plate) {
    uint64_t now = now_ns();
    plate->stamp_ns = now > plate->stamp_ns ? now : plate->stamp_ns + 1;
}

/* Read a reply with this id: HAPTICD_OK, HAPTICD_REFUSED with the sentence, or -1 for another one. */
static int read_reply(hapticd *plate, const uint8_t *bytes, size_t length, uint32_t id, uint64_t *t_ns) {
    reader in = {bytes, bytes + length, false};
    value head = next(&in);
    bool is_ok = false, is_own = false;
    char error[ERROR_BYTES] = "The daemon refused the request and gave no reason.";
    if (head.kind != KIND_MAP) return -1;
    for (size_t i = 0; i < head.count && !in.is_bad; i++) {
        value name = next(&in), one = next(&in);
        if (is_text(name, "id")) is_own = one.kind == KIND_NUMBER && (one.whole == id || one.whole == 0);
        if (is_text(name, "ok")) is_ok = one.kind == KIND_BOOL && one.count == 1;
        if (is_text(name, "error")) copy_text(error, sizeof error, one);
        if (is_text(name, "body") && one.kind == KIND_MAP) {
            for (size_t j = 0; j < one.count && !in.is_bad; j++) {
                value field = next(&in), inner = next(&in);
                if (t_ns != NULL && is_text(field, "t_ns")) *t_ns = inner.whole;
                skip(&in, inner, 2);
            }
        } else {
            skip(&in, one, 1);
        }
    }
    if (in.is_bad || !is_own) return -1;
    return is_ok ? HAPTICD_OK : fails(plate, HAPTICD_REFUSED, "%s", error);
}

static bool is_ready(void *socket, short event, uint64_t deadline_ns) {
    uint64_t now = now_ns();
    long left_ms = now >= deadline_ns ? 0 : (long)((deadline_ns - now) / 1000000u + 1);
    zmq_pollitem_t polled = {socket, 0, event, 0};
    return zmq_poll(&polled, 1, left_ms) > 0;
}

static uint64_t deadline_of(double timeout_s) {
    double bounded_s = timeout_s >= 0.0 && timeout_s <= 3600.0 ? timeout_s : timeout_s > 0.0 ? 3600.0 : 0.0;
    return now_ns() + (uint64_t)(bounded_s * 1e9);
}

/* Begin a request: the head of its map, up to the body. */
static void put_request(hapticd *plate, writer *out, const char *op, bool has_body) {
    plate->request_id = plate->request_id == UINT32_MAX ? 1 : plate->request_id + 1;
    put_map(out, has_body ? 4 : 3);
    put_text(out, "v");
    put_whole(out, 1);
    put_text(out, "id");
    put_whole(out, plate->request_id);
    put_text(out, "op");
    put_text(out, op);
    if (has_body) put_text(out, "body");
}

static int ask(hapticd *plate, const writer *request, uint64_t *t_ns) {
    uint64_t deadline_ns = deadline_of(plate->timeout_s);
    plate->error[0] = 0;
    if (request->is_full) return fails(plate, HAPTICD_REFUSED, "The message is longer than %zu bytes.", request->size);
    if (plate->control != NULL && is_ready(plate->control, ZMQ_POLLOUT, deadline_ns))
        zmq_send(plate->control, request->bytes, request->length, ZMQ_DONTWAIT);
    while (plate->control != NULL && is_ready(plate->control, ZMQ_POLLIN, deadline_ns)) {
        zmq_msg_t reply;
        zmq_msg_init(&reply);
        int code = -1;
        if (zmq_msg_recv(&reply, plate->control, ZMQ_DONTWAIT) >= 0)
            code = read_reply(plate, zmq_msg_data(&reply), zmq_msg_size(&reply), plate->request_id, t_ns);
        zmq_msg_close(&reply);
        if (code >= 0) return code;
    }
    return fails(plate, HAPTICD_GONE, "No hapticd answers at %s: start one, or set HAPTICD_RUNTIME_DIR.",
                 plate->directory);
}

/* Ask the daemon for all that is set now. */
static int send_all(hapticd *plate) {
    uint8_t bytes[MAX_BYTES];
    writer out = {bytes, 0, sizeof bytes, false};
    new_stamp(plate);
    put_request(plate, &out, "set", true);
    put_targets(plate, &out, false);
    plate->sent_ns = now_ns();
    return ask(plate, &out, NULL);
}

void hapticd_refresh(hapticd *plate) {
    if (plate->targets == NULL || plate->fingers.count + plate->surfaces.count == 0) return;
    if ((double)(now_ns() - plate->sent_ns) * 1e-9 < plate->ttl_s / REFRESHES) return;
    uint8_t bytes[MAX_BYTES];
    writer out = {bytes, 0, sizeof bytes, false};
    put_targets(plate, &out, true);
    if (!out.is_full) zmq_send(plate->targets, bytes, out.length, ZMQ_DONTWAIT);
    plate->sent_ns = now_ns();
}

/* --- what is set ------------------------------------------------------------------------------------------------ */

static item *find(item_list *list, uint32_t finger, const char *name) {
    for (size_t i = 0; i < list->count; i++)
        if (list->items[i].finger == finger && strcmp(list->items[i].name, name) == 0) return &list->items[i];
    return NULL;
}

static void drop(item_list *list, item *one) {
    size_t index = (size_t)(one - list->items);
    memmove(one, one + 1, (list->count - index - 1) * sizeof *one);
    list->count--;
}

/* Put an item in place of that with its key, else last, and ask; what the daemon refuses is as it was before. */
static int change(hapticd *plate, item_list *list, const item *made) {
    item_list *before = malloc(sizeof *before);
    if (before == NULL) return fails(plate, HAPTICD_REFUSED, "There is no memory.");
    *before = *list;
    item *same = find(list, made->finger, made->name);
    int code = HAPTICD_OK;
    if (same == NULL && list->count >= HAPTICD_MAX_TARGETS) {
        code = fails(plate, HAPTICD_REFUSED, "A client may hold %d of them at once.", HAPTICD_MAX_TARGETS);
    } else {
        if (same == NULL) same = &list->items[list->count++];
        *same = *made;
        code = send_all(plate);
    }
    if (code != HAPTICD_OK) {
        char sentence[ERROR_BYTES];
        memcpy(sentence, plate->error, sizeof sentence);
        *list = *before;
        if (code == HAPTICD_REFUSED) send_all(plate);
        memcpy(plate->error, sentence, sizeof sentence);
    }
    free(before);
    return code;
}

static writer item_writer(item *made) {
    writer out = {made->bytes, 0, sizeof made->bytes, false};
    return out;
}

static int set_field(hapticd *plate, uint32_t finger, const char *field, double number) {
    item made = {finger, "", false, 0, {0}};
    writer out = item_writer(&made);
    put_map(&out, 2);
    put_text(&out, "finger");
    put_whole(&out, finger);
    put_field(&out, field, number);
    made.length = out.length;
    return change(plate, &plate->fingers, &made);
}

int hapticd_set_friction(hapticd *plate, uint32_t finger, double friction) {
    return set_field(plate, finger, "friction", friction);
}

int hapticd_set_amplitude(hapticd *plate, uint32_t finger, double amplitude_um) {
    return set_field(plate, finger, "amplitude_um", amplitude_um);
}

int hapticd_set_grating(hapticd *plate, uint32_t finger, const hapticd_grating *grating) {
    item made = {finger, "", false, 0, {0}};
    writer out = item_writer(&made);
    put_map(&out, 2);
    put_text(&out, "finger");
    put_whole(&out, finger);
    put_text(&out, "grating");
    put_map(&out, 5);
    put_field(&out, "period_mm", grating->period_mm);
    put_field(&out, "high_um", grating->high_um);
    put_field(&out, "low_um", grating->low_um);
    put_field(&out, "angle_rad", grating->angle_rad);
    put_field(&out, "duty_frac", grating->duty_frac);
    made.length = out.length;
    return change(plate, &plate->fingers, &made);
}

static int release(hapticd *plate, bool has_finger, uint32_t finger) {
    uint8_t bytes[ITEM_BYTES];
    writer out = {bytes, 0, sizeof bytes, false};
    new_stamp(plate);
    put_request(plate, &out, "release", true);
    put_map(&out, has_finger ? 3 : 2);
    put_text(&out, "client");
    put_text(&out, plate->name);
    put_text(&out, "stamp");
    put_whole(&out, plate->stamp_ns);
    if (has_finger) {
        put_text(&out, "finger");
        put_whole(&out, finger);
    }
    return ask(plate, &out, NULL);
}

int hapticd_release(hapticd *plate, uint32_t finger) {
    item *held = find(&plate->fingers, finger, "");
    if (held != NULL) drop(&plate->fingers, held);
    return release(plate, true, finger);
}

int hapticd_release_all(hapticd *plate) {
    plate->fingers.count = plate->surfaces.count = 0;
    return release(plate, false, 0);
}

hapticd_surface hapticd_new_surface(void) {
    hapticd_surface made = {NAN, NAN, 0.0, {0.0, 0.0}, {0.0, 0.0}, 0.0, 0};
    return made;
}

int hapticd_lay_surface(hapticd *plate, const char *name, const hapticd_surface *surface) {
    item made = {0, "", false, 0, {0}};
    if (strlen(name) >= sizeof made.name) return fails(plate, HAPTICD_REFUSED, "name: has 1 .. 32 characters.");
    strcpy(made.name, name);
    bool has_friction = !isnan(surface->friction), has_amplitude = !isnan(surface->amplitude_um);
    bool is_circle = surface->circle_mm > 0.0, is_rectangle = surface->rectangle_mm[0] > 0.0;
    writer out = item_writer(&made);
    put_map(&out, (size_t)(4 + has_friction + has_amplitude + is_circle + is_rectangle));
    put_text(&out, "name");
    put_text(&out, name);
    if (has_friction) put_field(&out, "friction", surface->friction);
    if (has_amplitude) put_field(&out, "amplitude_um", surface->amplitude_um);
    if (is_circle) put_field(&out, "circle_mm", surface->circle_mm);
    if (is_rectangle) put_pair(&out, "rectangle_mm", surface->rectangle_mm);
    put_pair(&out, "position_mm", surface->position_mm);
    put_field(&out, "angle_rad", surface->angle_rad);
    put_text(&out, "z");
    put_signed(&out, surface->z);
    made.length = out.length;
    return change(plate, &plate->surfaces, &made);
}

int hapticd_remove_surface(hapticd *plate, const char *name) {
    item *held = find(&plate->surfaces, 0, name);
    if (held != NULL) drop(&plate->surfaces, held);
    return send_all(plate);
}

int hapticd_set_ttl(hapticd *plate, double ttl_s) {
    if (!(ttl_s >= 0.02 && ttl_s <= 5.0)) return fails(plate, HAPTICD_REFUSED, "ttl_s: must be 0.02 .. 5.");
    plate->ttl_s = ttl_s;
    plate->error[0] = 0;
    return HAPTICD_OK;
}

int hapticd_marker(hapticd *plate, const char *text, int pulse, uint64_t *t_ns) {
    uint8_t bytes[2 * ITEM_BYTES];
    writer out = {bytes, 0, sizeof bytes, false};
    put_request(plate, &out, "marker", true);
    put_map(&out, 3);
    put_text(&out, "client");
    put_text(&out, plate->name);
    put_text(&out, "text");
    put_text(&out, text);
    put_text(&out, "pulse");
    put_bool(&out, pulse != 0);
    return ask(plate, &out, t_ns);
}

/* --- states ------------------------------------------------------------------------------------------------------ */

static void read_finger(reader *in, hapticd_finger *finger, size_t fields) {
    finger->target_um = finger->achieved_um = finger->felt_friction = NAN;
    for (size_t i = 0; i < fields && !in->is_bad; i++) {
        value name = next(in), one = next(in);
        if (is_text(name, "id")) {
            finger->id = one.kind == KIND_NUMBER ? (uint32_t)one.whole : 0;
            copy_text(finger->name, sizeof finger->name, one);
        }
        if (is_text(name, "owner")) copy_text(finger->owner, sizeof finger->owner, one);
        if (is_text(name, "x_mm")) finger->x_mm = one.number;
        if (is_text(name, "y_mm")) finger->y_mm = one.number;
        if (is_text(name, "target_um")) finger->target_um = one.number;
        if (is_text(name, "achieved_um")) finger->achieved_um = one.number;
        if (is_text(name, "felt_friction")) finger->felt_friction = one.number;
        skip(in, one, 3);
    }
}

/* Forget the targets of fingers that were in a state and are in this one no more: ids are never used again. */
static void drop_lifted(hapticd *plate, const hapticd_state *state) {
    for (size_t i = plate->fingers.count; i-- > 0;) {
        item *held = &plate->fingers.items[i];
        bool is_down = false;
        for (size_t j = 0; j < state->fingers; j++) is_down |= state->finger[j].id == held->finger;
        if (held->was_down && !is_down && state->fingers < HAPTICD_MAX_FINGERS)
            drop(&plate->fingers, held);
        else
            held->was_down |= is_down;
    }
}

static void read_fingers(reader *in, hapticd_state *state, value head) {
    for (size_t i = 0; i < head.count && !in->is_bad; i++) {
        value one = next(in);
        if (one.kind == KIND_MAP && state->fingers < HAPTICD_MAX_FINGERS)
            read_finger(in, &state->finger[state->fingers++], one.count);
        else
            skip(in, one, 2);
    }
}

static bool read_state(hapticd_state *state, const uint8_t *bytes, size_t length) {
    reader in = {bytes, bytes + length, false};
    value head = next(&in);
    bool is_ours = false;
    memset(state, 0, sizeof *state);
    if (head.kind != KIND_MAP) return false;
    for (size_t i = 0; i < head.count && !in.is_bad; i++) {
        value name = next(&in), one = next(&in);
        if (is_text(name, "fingers") && one.kind == KIND_ARRAY) {
            read_fingers(&in, state, one);
            continue;
        }
        if (is_text(name, "v")) is_ours = one.kind == KIND_NUMBER && one.whole == 1;
        if (is_text(name, "instance")) state->instance = one.whole;
        if (is_text(name, "seq")) state->seq = one.whole;
        if (is_text(name, "t_ns")) state->t_ns = one.whole;
        if (is_text(name, "limited")) state->limited = one.kind == KIND_BOOL && one.count == 1;
        if (is_text(name, "age_ms")) state->age_ms = one.number;
        if (is_text(name, "state")) copy_text(state->state, sizeof state->state, one);
        skip(&in, one, 1);
    }
    return is_ours && !in.is_bad;
}

/* --- the connection ---------------------------------------------------------------------------------------------- */

static void *connected(hapticd *plate, int type, const char *socket_name) {
    char address[320];
    int zero = 0, one = 1, reconnect_ms = 10;
    void *socket = zmq_socket(plate->context, type);
    if (socket == NULL) return NULL;
    zmq_setsockopt(socket, ZMQ_LINGER, &zero, sizeof zero);
    zmq_setsockopt(socket, ZMQ_RECONNECT_IVL, &reconnect_ms, sizeof reconnect_ms);
    if (type == ZMQ_SUB) {
        zmq_setsockopt(socket, ZMQ_CONFLATE, &one, sizeof one);
        zmq_setsockopt(socket, ZMQ_SUBSCRIBE, "", 0);
    } else {
        zmq_setsockopt(socket, ZMQ_IMMEDIATE, &one, sizeof one);
    }
    snprintf(address, sizeof address, "ipc://%s/%s", plate->directory, socket_name);
    if (zmq_connect(socket, address) == 0) return socket;
    fails(plate, HAPTICD_REFUSED, "%s: is no runtime directory (%s).", plate->directory, zmq_strerror(zmq_errno()));
    zmq_close(socket);
    return NULL;
}

static bool has_daemon(const char *directory) {
    char control[sizeof((hapticd *)NULL)->directory + sizeof "/control"];
    struct stat found;
    snprintf(control, sizeof control, "%s/control", directory);
    return stat(control, &found) == 0 && S_ISSOCK(found.st_mode);
}

/* In /tmp anybody may make a directory: only this user's alone is trusted. */
static bool is_own(const char *directory) {
    struct stat found;
    return lstat(directory, &found) == 0 && S_ISDIR(found.st_mode) && found.st_uid == getuid() &&
           (found.st_mode & (S_IWGRP | S_IWOTH)) == 0;
}

static void choose_directory(hapticd *plate, const char *given) {
    const char *own = getenv("HAPTICD_RUNTIME_DIR"), *session = getenv("XDG_RUNTIME_DIR");
    char *directory = plate->directory;
    const size_t size = sizeof plate->directory;
    if (given == NULL && own != NULL && own[0] != 0) given = own;
    if (given != NULL) {
        snprintf(directory, size, "%s", given);
        return;
    }
    snprintf(directory, size, "%s/hapticd", session == NULL ? "" : session);
    if (session != NULL && has_daemon(directory)) return;
    snprintf(directory, size, "/tmp/hapticd-%u", (unsigned)getuid());
    if (!is_own(directory) || !has_daemon(directory)) snprintf(directory, size, "/run/hapticd");
}

hapticd *hapticd_open(const char *directory, const char *name, double timeout_s) {
    hapticd *plate = calloc(1, sizeof *plate);
    if (plate == NULL) return NULL;
    plate->timeout_s = timeout_s;
    plate->ttl_s = 0.5;
    snprintf(plate->name, sizeof plate->name, "%s", name);
    choose_directory(plate, directory);
    plate->context = zmq_ctx_new();
    if (plate->context == NULL) {
        fails(plate, HAPTICD_REFUSED, "ZeroMQ cannot start: %s.", zmq_strerror(zmq_errno()));
        return plate;
    }
    plate->control = connected(plate, ZMQ_DEALER, "control");
    if (plate->control != NULL) plate->targets = connected(plate, ZMQ_PUSH, "targets");
    if (plate->targets == NULL) return plate;
    uint8_t bytes[ITEM_BYTES];
    writer out = {bytes, 0, sizeof bytes, false};
    put_request(plate, &out, "hello", false);
    ask(plate, &out, NULL);
    return plate;
}

int hapticd_read(hapticd *plate, hapticd_state *state, double timeout_s) {
    uint64_t deadline_ns = deadline_of(timeout_s);
    plate->error[0] = 0;
    if (plate->telemetry == NULL && plate->targets != NULL) plate->telemetry = connected(plate, ZMQ_SUB, "telemetry");
    while (plate->telemetry != NULL) {
        uint64_t due_ns = now_ns() + (uint64_t)(plate->ttl_s * 1e9 / (2 * REFRESHES));
        bool has_state = is_ready(plate->telemetry, ZMQ_POLLIN, due_ns < deadline_ns ? due_ns : deadline_ns);
        hapticd_refresh(plate);
        if (has_state) {
            zmq_msg_t message;
            zmq_msg_init(&message);
            bool is_read = zmq_msg_recv(&message, plate->telemetry, ZMQ_DONTWAIT) >= 0 &&
                           read_state(state, zmq_msg_data(&message), zmq_msg_size(&message));
            zmq_msg_close(&message);
            if (is_read) drop_lifted(plate, state);
            if (is_read) return HAPTICD_OK;
        }
        if (now_ns() >= deadline_ns) break;
    }
    return fails(plate, HAPTICD_GONE, "No state from %s: check that hapticd runs.", plate->directory);
}

const char *hapticd_error(const hapticd *plate) { return plate == NULL ? "There is no memory." : plate->error; }

void hapticd_close(hapticd *plate) {
    if (plate == NULL) return;
    if (plate->targets != NULL) {
        plate->timeout_s = plate->timeout_s < 0.5 ? plate->timeout_s : 0.5;
        hapticd_release_all(plate);
    }
    if (plate->telemetry != NULL) zmq_close(plate->telemetry);
    if (plate->targets != NULL) zmq_close(plate->targets);
    if (plate->control != NULL) zmq_close(plate->control);
    if (plate->context != NULL) zmq_ctx_term(plate->context);
    free(plate);
}
