/* The iteration of `felt.py`, which explains the rule, and the shapes at the points of contacts.
 *
 * The compiler may not fuse products into sums: every machine gives the same bits. tests/core/solver/test_felt_descent.py
 * has the same iteration on arrays. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <string.h>

static const double WEBER_FRAC = 0.11;
static const double RATE = 0.3;            /* of the weights */
static const double LEAST_JND = 0.02;      /* smaller errors weigh alike */
static const double MOST_WEIGHT = 4.6;     /* of its logarithm: 100 either way */
static const double ROUND_UM = 0.05;       /* of amplitude, about which |r| is rounded */
static const double MOST_LESS = 1.5;       /* of its decay: by how much a point is pulled towards 0 at most; outwards once */
enum { SWEEPS = 4 };                       /* of an iteration */
enum { COLD = 9 };                         /* times as many iterations from rest */
static const double PAST_FRAC = 0.1;       /* 0.2 makes larger steps */
static const double TINY_UM = 1e-9;
static const double UNCERTAIN_FRAC = 0.01; /* of a mode's amplitude: map, gain and sensor together */
static const double COLD_TURN_RAD = 2.4;   /* from mode to mode at the start */
static const double MISSED_JND = 1.0;      /* more than this counts as limited */
static const double AT_LIMIT_FRAC = 0.995;
static const double SAFE = 1e100;
static const double INSIDE = 1.0 - 0x1p-50; /* of a limit: rounding leads nowhere beyond it */
enum { MOST_MODES = 16 };
enum { COEFFICIENTS = 16 }; /* of one surface in one cell: bicubic.py */

/* Numbers of all points lie one after another, (M, N Q) and (N Q,), so that the compiler computes two at a time; those of
 * one point's modes, (N Q, M) in pairs, the last one padded. Each number is computed as in Python, whatever its pair is. */
typedef double pair_t __attribute__((vector_size(2 * sizeof(double)), aligned(sizeof(double))));
#define PAIRS(modes) (((modes) + 1) / 2)
#define INLINE static inline __attribute__((always_inline))

typedef struct {
    Py_ssize_t fingers, points, modes, pieces, room; /* for an even number of points, N Q or one more */
    int is_point;
    const double *weights, *targets_um, *frictions, *counted, *stickiness, *gains, *starts_um, *origins_um, *decays_um, *limits_um;
    double keep, full_um, least, uncertain; /* uncertain: the square of the share of a mode's amplitude */
    const double *shapes;                                             /* (N Q, M) */
    double *across, *squared, *row_pairs;                             /* (M, N Q), the same squared, and (N Q, pairs) */
    double *w_d_um, *w_q_um, *rms_um, *friction, *rate_1_um, *decay_um, *kappa, *pulled; /* (N Q,) */
    double *d_um, *q_um, *pull_d, *pull_q, *centre_d, *centre_q;      /* (M,) */
    double *curvature;                                                /* (M, M) */
    double *log_weights, *errors, *contact_rms_um, *got, *logs;       /* (N,) */
    double *rates_1_um;                                               /* (pieces,) */
} problem_t;

/* Lays the shapes out as above. */
static void lay_out(problem_t *p)
{
    const Py_ssize_t modes = p->modes, places = p->fingers * p->points, room = p->room, width = 2 * PAIRS(modes);
    memset(p->across, 0, (size_t)(2 * modes * room) * sizeof(double)); /* and squared */
    for (Py_ssize_t place = 0; place < places; place++) {
        const double *row = &p->shapes[place * modes];
        p->row_pairs[place * width + width - 1] = 0.0;
        for (Py_ssize_t k = 0; k < modes; k++) {
            p->row_pairs[place * width + k] = row[k];
            p->across[k * room + place] = row[k];
            p->squared[k * room + place] = row[k] * row[k];
        }
    }
}

INLINE void move_points(problem_t *p, const Py_ssize_t modes)
{
    const Py_ssize_t room = p->room;
    double *restrict rms_um = p->rms_um;
    double d_um[MOST_MODES], q_um[MOST_MODES], squares[MOST_MODES];
    for (Py_ssize_t k = 0; k < modes; k++) {
        d_um[k] = p->d_um[k], q_um[k] = p->q_um[k];
        squares[k] = d_um[k] * d_um[k] + q_um[k] * q_um[k];
    }
    for (Py_ssize_t place = 0; place < room; place += 2) {
        pair_t d = {0.0, 0.0}, q = {0.0, 0.0}, uncertain = {0.0, 0.0};
        for (Py_ssize_t k = 0; k < modes; k++) {
            const pair_t across = *(const pair_t *)&p->across[k * room + place];
            d += across * d_um[k];
            q += across * q_um[k];
            uncertain += *(const pair_t *)&p->squared[k * room + place] * squares[k];
        }
        *(pair_t *)&p->w_d_um[place] = d;
        *(pair_t *)&p->w_q_um[place] = q;
        *(pair_t *)&rms_um[place] = d * d + q * q + p->uncertain * uncertain;
    }
    for (Py_ssize_t place = 0; place < room; place++)
        rms_um[place] = sqrt(rms_um[place]);
}

static void feel(problem_t *p)
{
    for (Py_ssize_t finger = 0, place = 0; finger < p->fingers; finger++) {
        const double share = 1.0 / p->gains[finger];
        double got = 0.0;
        for (Py_ssize_t index = 0; index < p->points; index++, place++) {
            const double at_um = p->rms_um[place] * share;
            Py_ssize_t piece = 0;
            while (piece + 1 < p->pieces && at_um >= p->starts_um[piece + 1])
                piece++;
            p->friction[place] =
                at_um < p->full_um ? exp((p->origins_um[piece] - at_um) * p->rates_1_um[piece]) : p->least;
            p->rate_1_um[place] = p->rates_1_um[piece] * share;
            p->decay_um[place] = p->decays_um[piece];
            got = got + p->weights[index] * p->friction[place];
        }
        const double wanted = p->frictions[finger];
        p->got[finger] = got;
        p->errors[finger] = (got - wanted) / (WEBER_FRAC * wanted);
    }
}

static void weigh(problem_t *p)
{
    double mean = 0.0, centre = 0.0;
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        double error = fabs(p->errors[finger]);
        error = error > LEAST_JND ? error : LEAST_JND;
        const double most = p->counted[finger];
        p->logs[finger] = log(error < most ? error : most);
        mean += p->logs[finger] / (double)p->fingers;
    }
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        p->log_weights[finger] = p->log_weights[finger] + RATE * (p->logs[finger] - mean);
        centre += p->log_weights[finger] / (double)p->fingers;
    }
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        const double weight = p->log_weights[finger] - centre;
        p->log_weights[finger] = weight > MOST_WEIGHT ? MOST_WEIGHT : (weight < -MOST_WEIGHT ? -MOST_WEIGHT : weight);
    }
}

/* The squares that replace a finger's error: kappa and pulled of its points. */
static void majorise(problem_t *p, Py_ssize_t finger)
{
    const Py_ssize_t first = finger * p->points, points = p->points;
    const double *restrict rms_um = p->rms_um + first, *restrict friction = p->friction + first;
    const double *restrict rate_1_um = p->rate_1_um + first, *restrict decay_um = p->decay_um + first;
    const double *restrict w_d_um = p->w_d_um + first, *restrict w_q_um = p->w_q_um + first;
    const double *restrict weights = p->weights;
    double *restrict kappa = p->kappa + first, *restrict pulled = p->pulled + first;
    const double wanted = p->frictions[finger], gain = p->gains[finger];
    const double alpha = exp(p->log_weights[finger]) / (WEBER_FRAC * wanted);
    const double stickiness = p->stickiness[finger];
    double outwards = (p->got[finger] - wanted) / p->got[finger];
    outwards = outwards > 1.0 ? 1.0 : (outwards < -MOST_LESS ? -MOST_LESS : outwards);
    for (Py_ssize_t index = 0; index < points; index++)
        kappa[index] = pulled[index] = 0.0;
    if (stickiness > 0.0)
        for (Py_ssize_t index = 0; index < points; index++) {
            const double slope = alpha * weights[index] * friction[index] * rate_1_um[index];
            kappa[index] = stickiness * slope / sqrt(rms_um[index] * rms_um[index] + ROUND_UM * ROUND_UM);
        }
    if (stickiness < 1.0)
        for (Py_ssize_t index = 0; index < points; index++) {
            const double slope = alpha * weights[index] * friction[index] * rate_1_um[index];
            const double along = (1.0 - stickiness) * slope * rate_1_um[index];
            double aim_um = rms_um[index] + decay_um[index] * gain * outwards;
            aim_um = aim_um > 0.0 ? aim_um : 0.0;
            const double size_um = sqrt(w_d_um[index] * w_d_um[index] + w_q_um[index] * w_q_um[index]);
            pulled[index] = along * aim_um / (size_um > TINY_UM ? size_um : TINY_UM);
            kappa[index] = kappa[index] + along;
        }
}

/* Of points the squares of their errors: each is pulled to what is asked, in the phase that it has. */
static void pull_points(problem_t *p)
{
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        p->kappa[finger] = 1.0;
        p->pulled[finger] = p->targets_um[finger] / fmax(p->rms_um[finger], TINY_UM);
    }
}

/* The sum of squares as a function of the modes: its curvature, below the diagonal, and the pull on each. */
INLINE void add_points(problem_t *p, const Py_ssize_t modes)
{
    const Py_ssize_t places = p->fingers * p->points, pairs = PAIRS(modes);
    pair_t curvature[MOST_MODES][PAIRS(MOST_MODES)], pull_d[PAIRS(MOST_MODES)], pull_q[PAIRS(MOST_MODES)];
    for (Py_ssize_t j = 0; j < pairs; j++) {
        pull_d[j] = pull_q[j] = (pair_t){0.0, 0.0};
        for (Py_ssize_t k = 0; k < modes; k++)
            curvature[k][j] = (pair_t){0.0, 0.0};
    }
    for (Py_ssize_t place = 0; place < places; place++) {
        const double *row = &p->row_pairs[place * 2 * pairs];
        const pair_t *row_pairs = (const pair_t *)row;
        const double kappa = p->kappa[place], pulled = p->pulled[place];
        const double towards_d = pulled * p->w_d_um[place], towards_q = pulled * p->w_q_um[place];
        for (Py_ssize_t k = 0; k < modes; k++) {
            const double part = kappa * row[k];
            for (Py_ssize_t j = 0; j <= k / 2; j++)
                curvature[k][j] = curvature[k][j] + part * row_pairs[j];
        }
        for (Py_ssize_t j = 0; j < pairs; j++) {
            pull_d[j] = pull_d[j] + towards_d * row_pairs[j];
            pull_q[j] = pull_q[j] + towards_q * row_pairs[j];
        }
    }
    for (Py_ssize_t k = 0; k < modes; k++) {
        p->pull_d[k] = pull_d[k / 2][k % 2], p->pull_q[k] = pull_q[k / 2][k % 2];
        for (Py_ssize_t other = 0; other <= k; other++)
            p->curvature[k * modes + other] = p->curvature[other * modes + k] = curvature[k][other / 2][other % 2];
    }
}

INLINE void sweep(problem_t *p, const Py_ssize_t modes, double stay_frac)
{
    double shares[MOST_MODES], d_um[MOST_MODES], q_um[MOST_MODES], pull_d[MOST_MODES], pull_q[MOST_MODES];
    double line[MOST_MODES][MOST_MODES], mean = 0.0;
    for (Py_ssize_t k = 0; k < modes; k++)
        mean += p->curvature[k * modes + k] / (double)modes;
    const double stay = stay_frac * mean;
    for (Py_ssize_t k = 0; k < modes; k++) {
        const double *curvature = &p->curvature[k * modes];
        const double own = (1.0 + p->uncertain) * curvature[k] + stay;
        const double share = own > 0.0 ? (1.0 + PAST_FRAC) / own : 0.0;
        d_um[k] = p->d_um[k], q_um[k] = p->q_um[k], shares[k] = share;
        pull_d[k] = share * (p->pull_d[k] + p->keep * stay * p->centre_d[k]);
        pull_q[k] = share * (p->pull_q[k] + p->keep * stay * p->centre_q[k]);
        for (Py_ssize_t other = 0; other < modes; other++)
            line[k][other] = share * curvature[other];
        line[k][k] = PAST_FRAC;
    }
    for (int turn = 0; turn < SWEEPS; turn++)
        for (Py_ssize_t k = 0; k < modes; k++) {
            const double limit_um = p->limits_um[k];
            double w_d_um = pull_d[k], w_q_um = pull_q[k];
            for (Py_ssize_t other = 0; other < modes; other++) {
                w_d_um -= line[k][other] * d_um[other];
                w_q_um -= line[k][other] * q_um[other];
            }
            const double square = w_d_um * w_d_um + w_q_um * w_q_um;
            if (!(shares[k] > 0.0 && square < SAFE * SAFE)) { /* no finger feels it, or products leave the range of floats */
                w_d_um = w_q_um = 0.0;
            } else if (square > INSIDE * limit_um * limit_um) {
                const double share = INSIDE * limit_um / sqrt(square);
                w_d_um = w_d_um * share;
                w_q_um = w_q_um * share;
            }
            d_um[k] = w_d_um, q_um[k] = w_q_um;
        }
    for (Py_ssize_t k = 0; k < modes; k++)
        p->d_um[k] = d_um[k], p->q_um[k] = q_um[k];
}

INLINE void iterate_for(problem_t *p, const Py_ssize_t modes, double stay_frac)
{
    move_points(p, modes);
    if (!p->is_point) {
        feel(p);
        weigh(p);
        for (Py_ssize_t finger = 0; finger < p->fingers; finger++)
            majorise(p, finger);
    } else {
        pull_points(p);
    }
    add_points(p, modes);
    sweep(p, modes, stay_frac);
}

/* Loops over a number of modes that the compiler knows are unrolled. */
static void iterate(problem_t *p, double stay_frac)
{
    switch (p->modes) {
    case 2: iterate_for(p, 2, stay_frac); break;
    case 3: iterate_for(p, 3, stay_frac); break;
    case 4: iterate_for(p, 4, stay_frac); break;
    case 5: iterate_for(p, 5, stay_frac); break;
    case 6: iterate_for(p, 6, stay_frac); break;
    case 7: iterate_for(p, 7, stay_frac); break;
    case 8: iterate_for(p, 8, stay_frac); break;
    default: iterate_for(p, p->modes, stay_frac);
    }
}

/* --- points: still fingers get exactly 0 --------------------------------------------------------------------------- */

static const double INDEPENDENT = 1e-12; /* of a row: what the others must leave of it */

static double dot(const double *one, const double *other, Py_ssize_t count)
{
    double total = 0.0;
    for (Py_ssize_t k = 0; k < count; k++)
        total += one[k] * other[k];
    return total;
}

/* Takes from a vector its projection on `size` orthonormal rows; twice leaves rounding alone. */
static void leave(const double *basis, Py_ssize_t size, double *vector, Py_ssize_t modes)
{
    for (int time = 0; time < 2; time++)
        for (Py_ssize_t row = 0; row < size; row++) {
            const double share = dot(&basis[row * modes], vector, modes);
            for (Py_ssize_t k = 0; k < modes; k++)
                vector[k] -= share * basis[row * modes + k];
        }
}

/* Returns the size of an orthonormal basis, of `size` rows, with this one; one that depends on it adds nothing. */
static Py_ssize_t with_row(double *basis, Py_ssize_t size, const double *row, Py_ssize_t modes)
{
    if (size == modes)
        return size;
    double *unit = &basis[size * modes];
    const double before = sqrt(dot(row, row, modes));
    memcpy(unit, row, (size_t)modes * sizeof(double));
    leave(basis, size, unit, modes);
    const double length = sqrt(dot(unit, unit, modes));
    if (!(length > INDEPENDENT * before))
        return size;
    for (Py_ssize_t k = 0; k < modes; k++)
        unit[k] /= length;
    leave(basis, size, unit, modes);
    return size + 1;
}

typedef struct {
    Py_ssize_t still, moved, slipping; /* rows of both bases; fingers that need one of the second */
    double still_rows[MOST_MODES * MOST_MODES], moved_rows[MOST_MODES * MOST_MODES];
    double centre_d[MOST_MODES], centre_q[MOST_MODES], off_d[MOST_MODES], off_q[MOST_MODES];
} freedom_t;

static const double RIDGE_FRAC = 0.3; /* of what keeps W, drawn to 0 where it is within half of the limits */
static const double HOLD_FRAC = 1.0; /* of the mean curvature, by which W is drawn towards what no still finger feels */

/* Leaves of each slipping finger's row (N, M) what no still finger feels, of a still one's nothing. */
static void free_rows(freedom_t *f, double *rows, const problem_t *p)
{
    const Py_ssize_t fingers = p->fingers, modes = p->modes;
    f->still = f->moved = f->slipping = 0;
    for (Py_ssize_t finger = 0; finger < fingers; finger++)
        if (p->targets_um[finger] == 0.0)
            f->still = with_row(f->still_rows, f->still, &rows[finger * modes], modes);
    for (Py_ssize_t finger = 0; finger < fingers; finger++) {
        double *row = &rows[finger * modes];
        const double before = sqrt(dot(row, row, modes));
        leave(f->still_rows, f->still, row, modes);
        if (p->targets_um[finger] == 0.0 || f->still == modes || !(sqrt(dot(row, row, modes)) > INDEPENDENT * before))
            memset(row, 0, (size_t)modes * sizeof(double));
        else
            f->slipping++, f->moved = with_row(f->moved_rows, f->moved, row, modes);
    }
}

/* W within the limits and V that no still finger feels draw each other, and what they still differ by adds up
 * (alternating direction method of multipliers: D. Gabay and B. Mercier, Computers & Mathematics with Applications 2,
 * 1976). The sweep is drawn towards V less that sum. */
static void begin_held(freedom_t *f, const problem_t *p)
{
    const size_t size = (size_t)p->modes * sizeof(double);
    memset(f->off_d, 0, size), memset(f->off_q, 0, size);
    memcpy(f->centre_d, p->d_um, size), memcpy(f->centre_q, p->q_um, size);
    leave(f->still_rows, f->still, f->centre_d, p->modes);
    leave(f->still_rows, f->still, f->centre_q, p->modes);
}

static void hold(freedom_t *f, const problem_t *p)
{
    double v_d[MOST_MODES], v_q[MOST_MODES];
    for (Py_ssize_t k = 0; k < p->modes; k++)
        v_d[k] = p->d_um[k] + f->off_d[k], v_q[k] = p->q_um[k] + f->off_q[k];
    leave(f->still_rows, f->still, v_d, p->modes);
    leave(f->still_rows, f->still, v_q, p->modes);
    for (Py_ssize_t k = 0; k < p->modes; k++) {
        f->off_d[k] += p->d_um[k] - v_d[k], f->off_q[k] += p->q_um[k] - v_q[k];
        f->centre_d[k] = v_d[k] - f->off_d[k], f->centre_q[k] = v_q[k] - f->off_q[k];
    }
}

static double largest_of(const problem_t *p, const double *d_um, const double *q_um)
{
    double largest = 0.0;
    for (Py_ssize_t k = 0; k < p->modes; k++)
        largest = fmax(largest, hypot(d_um[k], q_um[k]) / p->limits_um[k]);
    return largest;
}

static void scale_inside(problem_t *p)
{
    const double largest = largest_of(p, p->d_um, p->q_um);
    for (Py_ssize_t k = 0; k < p->modes && largest > INSIDE; k++)
        p->d_um[k] *= INSIDE / largest, p->q_um[k] *= INSIDE / largest;
}

/* The largest share of a step within the limits, of up to 1; they are discs, in which W is. */
static double share_within(const problem_t *p, const double *to_d, const double *to_q)
{
    double share = 1.0;
    for (Py_ssize_t k = 0; k < p->modes; k++) {
        const double d = to_d[k] - p->d_um[k], q = to_q[k] - p->q_um[k], limit_um = p->limits_um[k];
        const double room = limit_um * limit_um - p->d_um[k] * p->d_um[k] - p->q_um[k] * p->q_um[k];
        const double square = d * d + q * q, along = p->d_um[k] * d + p->q_um[k] * q;
        if (hypot(to_d[k], to_q[k]) > limit_um)
            share = fmin(share, (sqrt(along * along + square * fmax(room, 0.0)) - along) / square);
    }
    return share;
}

/* Takes from W what still fingers feel, and what no finger does where the limits allow it, and scales it into these. Then
 * W moves, as far as they allow, to the least amplitudes that give slipping fingers of independent rows what is asked, in
 * the phases that they have. */
static void free_amplitudes(const freedom_t *f, problem_t *p, const double *rows)
{
    const Py_ssize_t modes = p->modes;
    double to_d[MOST_MODES] = {0.0}, to_q[MOST_MODES] = {0.0};
    leave(f->still_rows, f->still, p->d_um, modes);
    leave(f->still_rows, f->still, p->q_um, modes);
    for (Py_ssize_t row = 0; row < f->moved; row++) {
        const double *unit = &f->moved_rows[row * modes], d = dot(unit, p->d_um, modes), q = dot(unit, p->q_um, modes);
        for (Py_ssize_t k = 0; k < modes; k++)
            to_d[k] += d * unit[k], to_q[k] += q * unit[k];
    }
    if (largest_of(p, to_d, to_q) <= INSIDE || f->moved == 0) {
        memcpy(p->d_um, to_d, sizeof(double) * (size_t)modes);
        memcpy(p->q_um, to_q, sizeof(double) * (size_t)modes);
    }
    scale_inside(p);
    if (f->moved < f->slipping)
        return;
    memset(to_d, 0, sizeof to_d), memset(to_q, 0, sizeof to_q);
    for (Py_ssize_t finger = 0, row = 0; row < f->moved; finger++) {
        const double *own = &rows[finger * modes], *unit = &f->moved_rows[row * modes];
        const double d = dot(own, p->d_um, modes), q = dot(own, p->q_um, modes), size = hypot(d, q);
        if (dot(own, own, modes) == 0.0)
            continue;
        const double share = size > 0.0 ? p->targets_um[finger] / size : 0.0, length = dot(own, unit, modes);
        const double more_d = (share * d - dot(own, to_d, modes)) / length;
        const double more_q = (share * q - dot(own, to_q, modes)) / length;
        for (Py_ssize_t k = 0; k < modes; k++) /* those before do not feel it */
            to_d[k] += more_d * unit[k], to_q[k] += more_q * unit[k];
        row++;
    }
    if (!(largest_of(p, to_d, to_q) < SAFE))
        return;
    const double share = share_within(p, to_d, to_q);
    for (Py_ssize_t k = 0; k < modes; k++) {
        p->d_um[k] += share * (to_d[k] - p->d_um[k]);
        p->q_um[k] += share * (to_q[k] - p->q_um[k]);
    }
    leave(f->still_rows, f->still, p->d_um, modes); /* what rounding added */
    leave(f->still_rows, f->still, p->q_um, modes);
    scale_inside(p);
}

static void measure(problem_t *p)
{
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        double square = 0.0;
        for (Py_ssize_t index = 0; index < p->points; index++) {
            const double *row = &p->shapes[(finger * p->points + index) * p->modes];
            double w_d_um = 0.0, w_q_um = 0.0;
            for (Py_ssize_t k = 0; k < p->modes; k++) {
                w_d_um += row[k] * p->d_um[k];
                w_q_um += row[k] * p->q_um[k];
            }
            square += p->weights[index] * (w_d_um * w_d_um + w_q_um * w_q_um);
        }
        p->contact_rms_um[finger] = sqrt(square);
    }
}

/* Shortens the way of W to at most so much in any mode. Limits hold on the whole way, because they are discs. */
static void step_towards(problem_t *p, const double *before_d, const double *before_q, double most_um)
{
    double largest_um = 0.0;
    for (Py_ssize_t k = 0; k < p->modes; k++)
        largest_um = fmax(largest_um, hypot(p->d_um[k] - before_d[k], p->q_um[k] - before_q[k]));
    for (Py_ssize_t k = 0; k < p->modes && largest_um > most_um; k++) {
        p->d_um[k] = before_d[k] + most_um / largest_um * (p->d_um[k] - before_d[k]);
        p->q_um[k] = before_q[k] + most_um / largest_um * (p->q_um[k] - before_q[k]);
    }
}

/* Whether some mode is at its limit while a finger feels that it misses its target. */
static int is_limited(const problem_t *p)
{
    int misses = 0;
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++)
        misses = misses || fabs(p->errors[finger]) > MISSED_JND;
    return misses && largest_of(p, p->d_um, p->q_um) >= AT_LIMIT_FRAC;
}

/* From rest the search starts from all modes alike, turned so that no pattern of signs is preferred. */
static void start(problem_t *p)
{
    double most_um = 0.0;
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++)
        most_um = fmax(most_um, p->targets_um[finger]);
    for (Py_ssize_t k = 0; k < p->modes; k++) {
        p->d_um[k] = fmin(p->limits_um[k], most_um) * cos(COLD_TURN_RAD * (double)k);
        p->q_um[k] = fmin(p->limits_um[k], most_um) * sin(COLD_TURN_RAD * (double)k);
    }
}

/* Moves W and the weights by so many iterations; by none the errors are those of W as it is. `freed` is room for (N, M). */
static void descend_for(problem_t *p, Py_ssize_t iterations, double stay_frac, double *freed)
{
    const double *shapes = p->shapes;
    freedom_t freedom = {.still = 0};
    if (p->is_point) {
        memcpy(freed, shapes, (size_t)(p->fingers * p->modes) * sizeof(double));
        free_rows(&freedom, freed, p);
        p->shapes = freed;
    }
    lay_out(p);
    const int is_held = freedom.still > 0;
    p->centre_d = is_held ? freedom.centre_d : p->d_um, p->centre_q = is_held ? freedom.centre_q : p->q_um;
    p->keep = p->is_point && !is_held ? 1.0 - RIDGE_FRAC * fmax(0.0, 1.0 - 2.0 * largest_of(p, p->d_um, p->q_um)) : 1.0;
    if (is_held)
        begin_held(&freedom, p);
    for (Py_ssize_t turn = 0; turn < iterations; turn++) {
        iterate(p, is_held ? HOLD_FRAC : stay_frac);
        if (is_held)
            hold(&freedom, p);
    }
    if (iterations == 0) {
        move_points(p, p->modes);
        feel(p);
    } else if (p->is_point) {
        free_amplitudes(&freedom, p, freed);
    }
    p->shapes = shapes;
    measure(p);
    for (Py_ssize_t finger = 0; finger < p->fingers && p->is_point; finger++) /* a noticeable difference, of amplitudes */
        p->errors[finger] = (p->contact_rms_um[finger] - p->targets_um[finger]) / (WEBER_FRAC * fmax(p->targets_um[finger], TINY_UM));
}

/* --- shapes at points: `ModeShapes.at` ---------------------------------------------------------------------------- */

typedef struct {
    const double *patches, *x_mm, *y_mm;
    Py_ssize_t modes, columns, rows; /* cells */
} tables_t;

/* The interval of a position within the knots: computed on an even grid, else by bisection. */
static Py_ssize_t interval(const double *knots_mm, Py_ssize_t last, double position_mm)
{
    const double per_mm = (double)last / (knots_mm[last] - knots_mm[0]);
    const double guess = (position_mm - knots_mm[0]) * per_mm;
    Py_ssize_t low = guess < (double)last ? (Py_ssize_t)guess : last - 1, high = last;
    if (knots_mm[low] <= position_mm && position_mm < knots_mm[low + 1])
        return low;
    for (low = 0; high - low > 1;) {
        const Py_ssize_t middle = (low + high) / 2;
        if (knots_mm[middle] <= position_mm)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static double clamped(double position_mm, const double *knots_mm, Py_ssize_t last)
{
    return position_mm < knots_mm[0] ? knots_mm[0] : (position_mm > knots_mm[last] ? knots_mm[last] : position_mm);
}

static void shapes_at(const tables_t *t, double x_mm, double y_mm, double *shapes)
{
    if (isnan(x_mm) || isnan(y_mm)) {
        memset(shapes, 0, (size_t)t->modes * sizeof(double));
        return;
    }
    x_mm = clamped(x_mm, t->x_mm, t->columns), y_mm = clamped(y_mm, t->y_mm, t->rows);
    const Py_ssize_t column = interval(t->x_mm, t->columns, x_mm), row = interval(t->y_mm, t->rows, y_mm);
    const double u = x_mm - t->x_mm[column], v = y_mm - t->y_mm[row];
    const pair_t *c = (const pair_t *)&t->patches[(row * t->columns + column) * t->modes * COEFFICIENTS];
    for (Py_ssize_t k = 0; k < t->modes; k++, c += COEFFICIENTS / 2) { /* two powers of y at a time */
        const pair_t low = ((c[6] * u + c[4]) * u + c[2]) * u + c[0], high = ((c[7] * u + c[5]) * u + c[3]) * u + c[1];
        shapes[k] = ((high[1] * v + high[0]) * v + low[1]) * v + low[0];
    }
}

/* --- Python's arrays: `felt_descent.pyi` has their shapes ----------------------------------------------------------- */

static Py_ssize_t doubles(const Py_buffer *buffer)
{
    return buffer->len / (Py_ssize_t)sizeof(double);
}

static PyObject *refused(void)
{
    PyErr_SetString(PyExc_ValueError, "felt_descent: the arrays' lengths do not fit");
    return NULL;
}

/* W as a tuple of complex numbers. */
static PyObject *phasors(const problem_t *p)
{
    PyObject *modal = PyTuple_New(p->modes);
    for (Py_ssize_t k = 0; k < p->modes && modal != NULL; k++) {
        PyObject *w_um = PyComplex_FromDoubles(p->d_um[k], p->q_um[k]);
        if (w_um == NULL)
            Py_CLEAR(modal);
        else
            PyTuple_SET_ITEM(modal, k, w_um);
    }
    return modal;
}

static PyObject *descend_over(const Py_buffer *given, PyObject *modal, Py_ssize_t iterations, double stay_frac, double most_step_um)
{
    enum { SHAPES, DISC, FINGERS, CURVE, LIMITS };
    const double *disc = given[DISC].buf, *curve = given[CURVE].buf;
    double *fingers = given[FINGERS].buf;
    const Py_ssize_t n = doubles(&given[FINGERS]) / 8, q = doubles(&given[DISC]) / 3, m = doubles(&given[LIMITS]);
    problem_t p = {.fingers = n, .points = q, .modes = m, .pieces = (doubles(&given[CURVE]) - 2) / 3, .is_point = q == 1};
    if (m > MOST_MODES || q < 1 || doubles(&given[CURVE]) < 5 || PyTuple_GET_SIZE(modal) != m ||
        doubles(&given[SHAPES]) != n * q * m)
        return refused();
    const Py_ssize_t places = n * q, room = places + places % 2;
    double *memory = PyMem_Malloc((size_t)(room * (2 * m + 8) + places * 2 * PAIRS(m) + q + p.pieces + m * m + 6 * m + n * (m + 2) + 1) * sizeof(double));
    if (memory == NULL)
        return PyErr_NoMemory();
    double *next = memory, *weights, *rates, *freed, *before_d, *before_q;
#define TAKE(count) (next += (count), next - (count))
    p.across = TAKE(room * m), p.squared = TAKE(room * m), p.row_pairs = TAKE(places * 2 * PAIRS(m));
    p.w_d_um = TAKE(room), p.w_q_um = TAKE(room), p.rms_um = TAKE(room), p.friction = TAKE(room);
    p.rate_1_um = TAKE(room), p.decay_um = TAKE(room), p.kappa = TAKE(room), p.pulled = TAKE(room);
    p.weights = weights = TAKE(q), p.rates_1_um = rates = TAKE(p.pieces), freed = TAKE(n * m), p.got = TAKE(n), p.logs = TAKE(n);
    p.curvature = TAKE(m * m), p.pull_d = TAKE(m), p.pull_q = TAKE(m), p.d_um = TAKE(m), p.q_um = TAKE(m);
    before_d = TAKE(m), before_q = TAKE(m);
#undef TAKE
    p.room = room, p.shapes = given[SHAPES].buf, p.limits_um = given[LIMITS].buf;
    p.uncertain = p.is_point ? 0.0 : UNCERTAIN_FRAC * UNCERTAIN_FRAC;
    p.targets_um = fingers, p.frictions = fingers + n, p.counted = fingers + 2 * n, p.stickiness = fingers + 3 * n;
    p.gains = fingers + 4 * n, p.log_weights = fingers + 5 * n, p.errors = fingers + 6 * n, p.contact_rms_um = fingers + 7 * n;
    p.full_um = curve[0], p.least = curve[1];
    p.starts_um = curve + 2, p.origins_um = p.starts_um + p.pieces, p.decays_um = p.origins_um + p.pieces;
    for (Py_ssize_t piece = 0; piece < p.pieces; piece++)
        rates[piece] = 1.0 / p.decays_um[piece];
    for (Py_ssize_t index = 0; index < q; index++)
        weights[index] = disc[3 * index + 2];
    int is_cold = iterations > 0;
    for (Py_ssize_t k = 0; k < m; k++) {
        const Py_complex w_um = PyComplex_AsCComplex(PyTuple_GET_ITEM(modal, k));
        p.d_um[k] = before_d[k] = w_um.real, p.q_um[k] = before_q[k] = w_um.imag;
        is_cold = is_cold && w_um.real == 0.0 && w_um.imag == 0.0;
    }
    if (PyErr_Occurred()) {
        PyMem_Free(memory);
        return NULL;
    }
    if (is_cold)
        start(&p);
    descend_for(&p, is_cold ? COLD * iterations : iterations, stay_frac, freed);
    const int limited = is_limited(&p);
    if (most_step_um < HUGE_VAL) {
        step_towards(&p, before_d, before_q, most_step_um);
        measure(&p);
    }
    PyObject *moved = phasors(&p);
    PyMem_Free(memory);
    return moved == NULL ? NULL : Py_BuildValue("NO", moved, limited ? Py_True : Py_False);
}

static PyObject *descend(PyObject *module, PyObject *arguments)
{
    (void)module;
    Py_buffer given[5];
    PyObject *modal;
    Py_ssize_t iterations;
    double stay_frac, most_step_um;
    if (!PyArg_ParseTuple(arguments, "y*y*w*y*y*O!ndd", &given[0], &given[1], &given[2], &given[3], &given[4],
                          &PyTuple_Type, &modal, &iterations, &stay_frac, &most_step_um))
        return NULL;
    PyObject *answer = descend_over(given, modal, iterations, stay_frac, most_step_um);
    for (int index = 0; index < 5; index++)
        PyBuffer_Release(&given[index]);
    return answer;
}

static PyObject *shapes_over(const Py_buffer *given)
{
    enum { PATCHES, X, Y, DISC, CONTACTS };
    tables_t t = {given[PATCHES].buf, given[X].buf, given[Y].buf, 0, doubles(&given[X]) - 1, doubles(&given[Y]) - 1};
    const Py_ssize_t patch = t.columns * t.rows * COEFFICIENTS, points = doubles(&given[DISC]) / 3;
    if (t.columns < 1 || t.rows < 1 || doubles(&given[PATCHES]) % patch != 0 || doubles(&given[CONTACTS]) % 5 != 0)
        return refused();
    t.modes = doubles(&given[PATCHES]) / patch;
    const Py_ssize_t fingers = doubles(&given[CONTACTS]) / 5;
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, fingers * points * t.modes * (Py_ssize_t)sizeof(double));
    double *next = bytes == NULL ? NULL : (double *)(void *)PyBytes_AS_STRING(bytes); /* aligned for them */
    for (Py_ssize_t finger = 0; finger < fingers && next != NULL; finger++) {
        const double *ellipse = (const double *)given[CONTACTS].buf + 5 * finger, *unit = given[DISC].buf;
        for (Py_ssize_t index = 0; index < points; index++, unit += 3, next += t.modes)
            shapes_at(&t, ellipse[0] + (ellipse[2] * unit[0] + ellipse[3] * unit[1]),
                      ellipse[1] + (ellipse[3] * unit[0] + ellipse[4] * unit[1]), next);
    }
    return bytes;
}

static PyObject *contact_shapes(PyObject *module, PyObject *arguments)
{
    (void)module;
    Py_buffer given[5];
    if (!PyArg_ParseTuple(arguments, "(y*y*y*)y*y*", &given[0], &given[1], &given[2], &given[3], &given[4]))
        return NULL;
    PyObject *answer = shapes_over(given);
    for (int index = 0; index < 5; index++)
        PyBuffer_Release(&given[index]);
    return answer;
}

static PyMethodDef methods[] = {
    {"descend", descend, METH_VARARGS, "See felt_descent.pyi."},
    {"contact_shapes", contact_shapes, METH_VARARGS, "See felt_descent.pyi."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "felt_descent", "The descent of `felt`.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit_felt_descent(void)
{
    PyObject *module = PyModule_Create(&definition);
    if (module != NULL && (PyModule_AddObject(module, "UNCERTAIN_FRAC", PyFloat_FromDouble(UNCERTAIN_FRAC)) < 0 ||
                           PyModule_AddObject(module, "COLD", PyLong_FromLong(COLD)) < 0))
        Py_CLEAR(module);
    return module;
}
