/* The iteration of `instant.py`, which explains the rule; `felt_descent.pyi` has the shapes of the arrays.
 *
 * The compiler may not fuse products into sums: every machine gives the same bits. tests/core/solver/test_felt_descent.py
 * has the same iteration on arrays. */

#include "../plate/surfaces.h"

static const double WEBER_FRAC = 0.11;
static const double RATE = 0.3;            /* of the weights */
static const double LEAST_JND = 0.3;       /* smaller errors weigh alike */
static const double EVEN_FRAC = 0.5;       /* of a point's way to the mean of its contact, if the finger has no error */
static const double MOST_WEIGHT = 4.6;     /* of its logarithm: 100 either way */
static const double ROUND_UM = 0.2;        /* of amplitude, about which |r| is rounded */
static const double MOST_LESS = 1.5;       /* of its decay: by how much a point is pulled towards 0 at most; outwards once */
enum { SWEEPS = 4 };                       /* of an iteration */
enum { COLD = 9 };                         /* times as many iterations from silence */
enum { BRIEF = 100 };                      /* iterations; a longer descent is of a plate at rest, and has no ridge */
static const double PAST_FRAC = 0.1;       /* 0.2 makes larger steps */
static const double STAY_FRAC = 0.03;      /* of the mean curvature: keeps W where directions are nearly equal */
static const double RIDGE_FRAC = 0.3;      /* of what keeps W, drawn to 0 where it is within half of the limits */
static const double INDEPENDENT = 1e-12;   /* of a row: what the others must leave of it */
static const double TINY_UM = 1e-9;
static const double UNCERTAIN_FRAC = 0.01; /* of a mode's amplitude, by map and sensor, if the plate is measured well */
static const double COLD_TURN_RAD = 2.4;   /* from mode to mode at the start */
static const double MISSED_JND = 1.0;      /* more than this counts as limited */
static const double AT_LIMIT_FRAC = 0.995;
static const double SAFE = 1e100;
static const double INSIDE = 1.0 - 0x1p-50; /* of a limit: rounding leads nowhere beyond it */
enum { MOST_MODES = 8 };

#define INLINE static inline __attribute__((always_inline))

typedef struct {
    Py_ssize_t fingers, points, modes, pieces, room; /* for an even number of points, N Q or one more */
    int is_point;
    const double *shapes, *weights, *limits_um;                                              /* (N Q, M), (Q,), (M,) */
    const double *targets_um, *frictions, *counted, *stickiness, *gains;                     /* (N,) */
    const double *starts_um, *origins_um, *rates_1_um;                                       /* (pieces,) */
    double full_um, least, uncertain, even, keep; /* uncertain: the square of the share of a mode's amplitude */
    double *log_weights, *errors, *contact_rms_um, *got, *logs, *mean_um;                    /* (N,) */
    double *rows, *across;                                 /* what W acts on: (N Q, M) and one more, and (M, room) */
    double *w_d_um, *w_q_um, *rms_um, *friction, *rate_1_um, *kappa, *pulled;                /* (room,) */
    double curvature[MOST_MODES][MOST_MODES];
    pair_t w_um[MOST_MODES], pull[MOST_MODES];
    Py_ssize_t still, moved, slipping; /* of points: rows of both bases; fingers that need one of the second */
    double still_rows[MOST_MODES * MOST_MODES], moved_rows[MOST_MODES * MOST_MODES];
    pair_t centre_um[MOST_MODES], off_um[MOST_MODES];
} problem_t;

static double length(pair_t phasor)
{
    return hypot(phasor[0], phasor[1]);
}

/* --- the iteration --------------------------------------------------------------------------------------------------- */

INLINE void move_points(problem_t *p, const Py_ssize_t modes)
{
    const Py_ssize_t room = p->room;
    double *restrict rms_um = p->rms_um;
    double squares[MOST_MODES];
    for (Py_ssize_t k = 0; k < modes; k++)
        squares[k] = p->uncertain * (p->w_um[k][0] * p->w_um[k][0] + p->w_um[k][1] * p->w_um[k][1]);
    for (Py_ssize_t place = 0; place < room; place += 2) {
        pair_t d = {0.0, 0.0}, q = {0.0, 0.0}, uncertain = {0.0, 0.0};
        for (Py_ssize_t k = 0; k < modes; k++) {
            const pair_t across = *(const pair_t *)&p->across[k * room + place];
            d += across * p->w_um[k][0];
            q += across * p->w_um[k][1];
            uncertain += across * across * squares[k];
        }
        *(pair_t *)&p->w_d_um[place] = d;
        *(pair_t *)&p->w_q_um[place] = q;
        *(pair_t *)&rms_um[place] = d * d + q * q + uncertain;
    }
    for (Py_ssize_t place = 0; place < room; place++)
        rms_um[place] = sqrt(rms_um[place]);
}

static void feel(problem_t *p)
{
    for (Py_ssize_t finger = 0, place = 0; finger < p->fingers; finger++) {
        const double share = 1.0 / p->gains[finger], target = p->frictions[finger];
        double got = 0.0, mean_um = 0.0;
        for (Py_ssize_t index = 0; index < p->points; index++, place++) {
            const double at_um = p->rms_um[place] * share;
            Py_ssize_t piece = 0;
            while (piece + 1 < p->pieces && at_um >= p->starts_um[piece + 1])
                piece++;
            p->friction[place] =
                at_um < p->full_um ? exp((p->origins_um[piece] - at_um) * p->rates_1_um[piece]) : p->least;
            p->rate_1_um[place] = p->rates_1_um[piece] * share;
            got += p->weights[index] * p->friction[place];
            mean_um += p->weights[index] * p->rms_um[place];
        }
        p->got[finger] = got, p->mean_um[finger] = mean_um;
        p->errors[finger] = (got - target) / (WEBER_FRAC * target);
    }
}

static void weigh(problem_t *p)
{
    double mean = 0.0, centre = 0.0;
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        const double size = fabs(p->errors[finger]), less = fmax(1.0 - size, 0.0);
        p->logs[finger] = log(fmin(fmax(size * (1.0 - p->stickiness[finger] * less), LEAST_JND), p->counted[finger]));
        mean += p->logs[finger] / (double)p->fingers;
    }
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        p->log_weights[finger] += RATE * (p->logs[finger] - mean);
        centre += p->log_weights[finger] / (double)p->fingers;
    }
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++)
        p->log_weights[finger] = fmax(fmin(p->log_weights[finger] - centre, MOST_WEIGHT), -MOST_WEIGHT);
}

/* The squares that replace a finger's error: kappa and pulled of its points. */
static void majorise(problem_t *p, Py_ssize_t finger)
{
    const Py_ssize_t first = finger * p->points, points = p->points;
    const double *restrict rms_um = p->rms_um + first, *restrict friction = p->friction + first;
    const double *restrict rate_1_um = p->rate_1_um + first, *restrict weights = p->weights;
    const double *restrict w_d_um = p->w_d_um + first, *restrict w_q_um = p->w_q_um + first;
    double *restrict kappa = p->kappa + first, *restrict pulled = p->pulled + first;
    const double target = p->frictions[finger], got = p->got[finger];
    const double alpha = exp(p->log_weights[finger]) / (WEBER_FRAC * target);
    const double to_zero = alpha * p->stickiness[finger], along = alpha * (1.0 - p->stickiness[finger]);
    const double even = p->even / (1.0 + p->errors[finger] * p->errors[finger]), mean_um = p->mean_um[finger];
    const double outwards = fmax(fmin((got - target) / got, 1.0), -MOST_LESS);
    const Py_ssize_t stuck = to_zero > 0.0 ? points : 0, pulling = along > 0.0 ? points : 0;
    for (Py_ssize_t index = 0; index < points; index++)
        kappa[index] = pulled[index] = 0.0;
    for (Py_ssize_t index = 0; index < stuck; index++) {
        const double slope = to_zero * weights[index] * friction[index] * rate_1_um[index];
        kappa[index] = slope / sqrt(rms_um[index] * rms_um[index] + ROUND_UM * ROUND_UM);
    }
    for (Py_ssize_t index = 0; index < pulling; index++) {
        const double slope = along * weights[index] * friction[index] * rate_1_um[index];
        const double size_um = sqrt(w_d_um[index] * w_d_um[index] + w_q_um[index] * w_q_um[index]);
        const double aim_um = rms_um[index] + even * (mean_um - rms_um[index]), reach = aim_um * rate_1_um[index] + outwards;
        pulled[index] = slope * (reach > 0.0 ? reach : 0.0) / (size_um > TINY_UM ? size_um : TINY_UM);
        kappa[index] += slope * rate_1_um[index];
    }
}

/* The sum of squares as a function of the modes: its curvature, and the pull on each. */
INLINE void add_points(problem_t *p, const Py_ssize_t modes)
{
    const Py_ssize_t places = p->fingers * p->points, pairs = (modes + 1) / 2; /* an odd one is padded by what follows it */
    pair_t curvature[MOST_MODES][MOST_MODES / 2], pull_d[MOST_MODES / 2], pull_q[MOST_MODES / 2];
    memset(curvature, 0, sizeof curvature), memset(pull_d, 0, sizeof pull_d), memset(pull_q, 0, sizeof pull_q);
    for (Py_ssize_t place = 0; place < places; place++) {
        const double *row = &p->rows[place * modes];
        const pair_t *row_pairs = (const pair_t *)row;
        const double towards_d = p->pulled[place] * p->w_d_um[place], towards_q = p->pulled[place] * p->w_q_um[place];
        for (Py_ssize_t k = 0; k < modes; k++) {
            const double part = p->kappa[place] * row[k];
            for (Py_ssize_t j = 0; j <= k / 2; j++)
                curvature[k][j] += part * row_pairs[j];
        }
        for (Py_ssize_t j = 0; j < pairs; j++) {
            pull_d[j] += towards_d * row_pairs[j];
            pull_q[j] += towards_q * row_pairs[j];
        }
    }
    for (Py_ssize_t k = 0; k < modes; k++) {
        p->pull[k] = (pair_t){pull_d[k / 2][k % 2], pull_q[k / 2][k % 2]};
        for (Py_ssize_t other = 0; other <= k; other++)
            p->curvature[k][other] = p->curvature[other][k] = curvature[k][other / 2][other % 2];
    }
}

INLINE void sweep(problem_t *p, const Py_ssize_t modes)
{
    double shares[MOST_MODES], line[MOST_MODES][MOST_MODES], mean = 0.0;
    pair_t w_um[MOST_MODES], pull[MOST_MODES];
    for (Py_ssize_t k = 0; k < modes; k++)
        mean += p->curvature[k][k] / (double)modes;
    const double stay = p->still > 0 ? mean : STAY_FRAC * mean; /* drawn towards what no still finger feels, or to where it is */
    for (Py_ssize_t k = 0; k < modes; k++) {
        const double own = (1.0 + p->uncertain) * p->curvature[k][k] + stay;
        shares[k] = own > 0.0 ? (1.0 + PAST_FRAC) / own : 0.0;
        w_um[k] = p->w_um[k];
        pull[k] = shares[k] * (p->pull[k] + p->keep * stay * (p->still > 0 ? p->centre_um[k] : w_um[k]));
        for (Py_ssize_t other = 0; other < modes; other++)
            line[k][other] = shares[k] * p->curvature[k][other];
        line[k][k] = PAST_FRAC;
    }
    for (int turn = 0; turn < SWEEPS; turn++)
        for (Py_ssize_t k = 0; k < modes; k++) {
            pair_t moved_um = pull[k];
            for (Py_ssize_t other = 0; other < modes; other++)
                moved_um -= line[k][other] * w_um[other];
            const double square = moved_um[0] * moved_um[0] + moved_um[1] * moved_um[1], limit_um = p->limits_um[k];
            if (!(shares[k] > 0.0 && square < SAFE * SAFE)) /* no finger feels it, or products leave the range of floats */
                moved_um = (pair_t){0.0, 0.0};
            else if (square > INSIDE * limit_um * limit_um)
                moved_um *= INSIDE * limit_um / sqrt(square);
            w_um[k] = moved_um;
        }
    memcpy(p->w_um, w_um, sizeof w_um);
}

INLINE void iterate_for(problem_t *p, const Py_ssize_t modes)
{
    move_points(p, modes);
    if (!p->is_point) {
        feel(p);
        weigh(p);
    }
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++)
        if (p->is_point) /* the square of its error: it is pulled to what is asked, in the phase that it has */
            p->kappa[finger] = 1.0, p->pulled[finger] = p->targets_um[finger] / fmax(p->rms_um[finger], TINY_UM);
        else
            majorise(p, finger);
    add_points(p, modes);
    sweep(p, modes);
}

/* Loops over a number of modes that the compiler knows are unrolled. */
static void iterate(problem_t *p)
{
    switch (p->modes) {
    case 2: iterate_for(p, 2); break;
    case 4: iterate_for(p, 4); break;
    case 6: iterate_for(p, 6); break;
    case 8: iterate_for(p, 8); break;
    default: iterate_for(p, p->modes);
    }
}

/* --- points: still fingers get exactly 0 --------------------------------------------------------------------------- */

static double dot(const double *one, const double *other, Py_ssize_t stride, Py_ssize_t modes)
{
    double total = 0.0;
    for (Py_ssize_t k = 0; k < modes; k++)
        total += one[k] * other[k * stride];
    return total;
}

/* Takes from a vector its projection on `size` orthonormal rows; twice leaves rounding alone. */
static void leave(const double *basis, Py_ssize_t size, double *vector, Py_ssize_t stride, Py_ssize_t modes)
{
    for (Py_ssize_t time = 0; time < 2 * size; time++) {
        const double *unit = &basis[time % size * modes], share = dot(unit, vector, stride, modes);
        for (Py_ssize_t k = 0; k < modes; k++)
            vector[k * stride] -= share * unit[k];
    }
}

/* Takes from phasors what still fingers feel. */
static void leave_still(const problem_t *p, pair_t *w_um)
{
    for (int part = 0; part < 2; part++)
        leave(p->still_rows, p->still, (double *)w_um + part, 2, p->modes);
}

/* Returns the size of an orthonormal basis, of `size` rows, with this one; one that depends on it adds nothing. */
static Py_ssize_t with_row(double *basis, Py_ssize_t size, const double *row, Py_ssize_t modes)
{
    if (size == modes)
        return size;
    double *unit = &basis[size * modes];
    memcpy(unit, row, (size_t)modes * sizeof(double));
    leave(basis, size, unit, 1, modes);
    const double left = sqrt(dot(unit, unit, 1, modes));
    if (!(left > INDEPENDENT * sqrt(dot(row, row, 1, modes))))
        return size;
    for (Py_ssize_t k = 0; k < modes; k++)
        unit[k] /= left;
    leave(basis, size, unit, 1, modes);
    return size + 1;
}

/* Leaves of each slipping finger's row what no still finger feels, of a still one's nothing. */
static void free_rows(problem_t *p)
{
    const Py_ssize_t modes = p->modes;
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++)
        if (p->targets_um[finger] == 0.0)
            p->still = with_row(p->still_rows, p->still, &p->rows[finger * modes], modes);
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        double *row = &p->rows[finger * modes];
        const double before = sqrt(dot(row, row, 1, modes));
        leave(p->still_rows, p->still, row, 1, modes);
        const int is_free = p->still < modes && sqrt(dot(row, row, 1, modes)) > INDEPENDENT * before;
        if (p->targets_um[finger] == 0.0 || !is_free)
            memset(row, 0, (size_t)modes * sizeof(double));
        else
            p->slipping++, p->moved = with_row(p->moved_rows, p->moved, row, modes);
    }
}

/* W within the limits and V that no still finger feels draw each other, and what they still differ by adds up
 * (alternating direction method of multipliers: D. Gabay and B. Mercier, Computers & Mathematics with Applications 2,
 * 1976). The sweep is drawn towards V less that sum. */
static void hold(problem_t *p)
{
    pair_t v_um[MOST_MODES];
    for (Py_ssize_t k = 0; k < p->modes; k++)
        v_um[k] = p->w_um[k] + p->off_um[k];
    leave_still(p, v_um);
    for (Py_ssize_t k = 0; k < p->modes; k++) {
        p->off_um[k] += p->w_um[k] - v_um[k];
        p->centre_um[k] = v_um[k] - p->off_um[k];
    }
}

static double largest_of(const problem_t *p, const pair_t *w_um)
{
    double largest = 0.0;
    for (Py_ssize_t k = 0; k < p->modes; k++)
        largest = fmax(largest, length(w_um[k]) / p->limits_um[k]);
    return largest;
}

static void scale_inside(problem_t *p)
{
    const double largest = largest_of(p, p->w_um);
    for (Py_ssize_t k = 0; k < p->modes && largest > INSIDE; k++)
        p->w_um[k] *= INSIDE / largest;
}

/* The largest share of a step within the limits, of up to 1; they are discs, in which W is. */
static double share_within(const problem_t *p, const pair_t *to_um)
{
    double share = 1.0;
    for (Py_ssize_t k = 0; k < p->modes; k++) {
        const pair_t w_um = p->w_um[k], step = to_um[k] - w_um, squares = step * step, sides = w_um * step, own = w_um * w_um;
        const double limit_um = p->limits_um[k], square = squares[0] + squares[1], along = sides[0] + sides[1];
        const double room = fmax(limit_um * limit_um - own[0] - own[1], 0.0);
        if (length(to_um[k]) > limit_um)
            share = fmin(share, (sqrt(along * along + square * room) - along) / square);
    }
    return share;
}

/* Takes from W what still fingers feel, and scales it into the limits. Then W moves, as far as they allow, to the least
 * amplitudes that give slipping fingers of independent rows what is asked, in the phases that they have. */
static void free_amplitudes(problem_t *p)
{
    const Py_ssize_t modes = p->modes;
    pair_t to_um[MOST_MODES] = {{0.0, 0.0}};
    leave_still(p, p->w_um);
    scale_inside(p);
    if (p->moved < p->slipping)
        return;
    for (Py_ssize_t finger = 0, row = 0; row < p->moved; finger++) {
        const double *own = &p->rows[finger * modes], *unit = &p->moved_rows[row * modes];
        pair_t missed_um = {0.0, 0.0}, w_um = {0.0, 0.0};
        for (Py_ssize_t k = 0; k < modes; k++)
            w_um += own[k] * p->w_um[k], missed_um -= own[k] * to_um[k];
        if (dot(own, own, 1, modes) == 0.0)
            continue;
        if (length(w_um) > 0.0)
            missed_um += p->targets_um[finger] / length(w_um) * w_um;
        missed_um /= dot(own, unit, 1, modes);
        for (Py_ssize_t k = 0; k < modes; k++) /* those before do not feel it */
            to_um[k] += missed_um * unit[k];
        row++;
    }
    if (!(largest_of(p, to_um) < SAFE))
        return;
    const double share = share_within(p, to_um);
    for (Py_ssize_t k = 0; k < modes; k++)
        p->w_um[k] += share * (to_um[k] - p->w_um[k]);
    leave_still(p, p->w_um); /* what rounding added */
    scale_inside(p);
}

/* --- a solve --------------------------------------------------------------------------------------------------------- */

static void measure(problem_t *p)
{
    const double *row = p->shapes;
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        double square = 0.0;
        for (Py_ssize_t index = 0; index < p->points; index++, row += p->modes) {
            const double d_um = dot(row, (double *)p->w_um, 2, p->modes), q_um = dot(row, (double *)p->w_um + 1, 2, p->modes);
            square += p->weights[index] * (d_um * d_um + q_um * q_um);
        }
        p->contact_rms_um[finger] = sqrt(square);
    }
}

/* Shortens the way of W to at most so much in any mode. Limits hold on the whole way, because they are discs. */
static void step_towards(problem_t *p, const pair_t *before_um, double most_um)
{
    double largest_um = 0.0;
    for (Py_ssize_t k = 0; k < p->modes; k++)
        largest_um = fmax(largest_um, length(p->w_um[k] - before_um[k]));
    for (Py_ssize_t k = 0; k < p->modes && largest_um > most_um; k++)
        p->w_um[k] = before_um[k] + most_um / largest_um * (p->w_um[k] - before_um[k]);
}

/* Moves W and the weights by so many iterations; by none the errors are those of W as it is. Returns whether some mode is
 * at its limit while a finger feels that it misses its target. */
static int descend_for(problem_t *p, Py_ssize_t iterations, double most_step_um)
{
    pair_t before_um[MOST_MODES];
    double most_um = 0.0;
    memcpy(before_um, p->w_um, sizeof before_um);
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++)
        most_um = fmax(most_um, p->targets_um[finger]);
    if (most_um == 0.0 && iterations > 0) { /* no finger slips: silence is never slow */
        memset(p->w_um, 0, sizeof p->w_um);
        iterations = 0, most_step_um = INFINITY;
    } else if (largest_of(p, p->w_um) == 0.0 && iterations > 0) { /* from all modes alike, so that no pattern of signs is preferred */
        iterations *= COLD;
        for (Py_ssize_t k = 0; k < p->modes; k++)
            p->w_um[k] = fmin(p->limits_um[k], most_um) * (pair_t){cos(COLD_TURN_RAD * (double)k), sin(COLD_TURN_RAD * (double)k)};
    }
    if (p->is_point)
        free_rows(p);
    for (Py_ssize_t place = 0; place < p->fingers * p->points; place++)
        for (Py_ssize_t k = 0; k < p->modes; k++)
            p->across[k * p->room + place] = p->rows[place * p->modes + k];
    const int has_ridge = p->is_point && p->still == 0 && iterations < BRIEF;
    p->keep = has_ridge ? 1.0 - RIDGE_FRAC * fmax(0.0, 1.0 - 2.0 * largest_of(p, p->w_um)) : 1.0;
    if (iterations > 0)
        leave_still(p, p->w_um);
    for (Py_ssize_t turn = 0; turn < iterations; turn++) {
        if (p->still > 0)
            hold(p);
        iterate(p);
    }
    if (iterations == 0) {
        move_points(p, p->modes);
        feel(p);
    } else if (p->is_point) {
        free_amplitudes(p);
    }
    int misses = 0, is_at_limit = largest_of(p, p->w_um) >= AT_LIMIT_FRAC;
    step_towards(p, before_um, most_step_um);
    measure(p);
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        if (p->is_point) /* a noticeable difference, of amplitudes */
            p->errors[finger] = (p->contact_rms_um[finger] / fmax(p->targets_um[finger], TINY_UM) - 1.0) / WEBER_FRAC;
        misses = misses || fabs(p->errors[finger]) > MISSED_JND;
    }
    return misses && is_at_limit;
}

/* --- Python's arrays ------------------------------------------------------------------------------------------------- */

enum { SHAPES, WEIGHTS, FINGERS, CURVE, LIMITS, ARRAYS };

/* Numbers that the own arrays of a problem take. */
static size_t own_size(const problem_t *p)
{
    return (size_t)(p->room * (p->modes + 7) + p->fingers * (p->points * p->modes + 3) + 1);
}

/* Solves for the fingers of `table` (8, N), and writes its answers; `memory` has room for the problem's own arrays. */
static int descend_in(problem_t *p, double *table, double *memory, Py_ssize_t iterations, double most_step_um)
{
    const Py_ssize_t n = p->fingers;
    double *next = memory, **per_place[] = {&p->w_d_um, &p->w_q_um, &p->rms_um, &p->friction, &p->rate_1_um, &p->kappa, &p->pulled};
    memset(memory, 0, own_size(p) * sizeof(double));
    for (size_t index = 0; index < sizeof per_place / sizeof *per_place; index++, next += p->room)
        *per_place[index] = next;
    p->across = next, p->got = next + p->room * p->modes, p->logs = p->got + n, p->mean_um = p->logs + n, p->rows = p->mean_um + n;
    memcpy(p->rows, p->shapes, (size_t)(n * p->points * p->modes) * sizeof(double));
    p->targets_um = table, p->frictions = table + n, p->counted = table + 2 * n, p->stickiness = table + 3 * n;
    p->gains = table + 4 * n, p->log_weights = table + 5 * n, p->errors = table + 6 * n, p->contact_rms_um = table + 7 * n;
    p->still = p->moved = p->slipping = 0;
    memset(p->off_um, 0, sizeof p->off_um);
    return descend_for(p, iterations, most_step_um);
}

/* Solves for one instant after another; returns a list of pairs: W, and whether a limit keeps a finger from its target. */
static PyObject *descend_along(problem_t *p, double *table, PyObject *steps_um, double *memory, Py_ssize_t iterations)
{
    const Py_ssize_t instants = PyTuple_GET_SIZE(steps_um), n = p->fingers;
    PyObject *found = PyList_New(instants);
    for (Py_ssize_t instant = 0; found != NULL && instant < instants; instant++, table += 8 * n) {
        const int limited = descend_in(p, table, memory, iterations, PyFloat_AsDouble(PyTuple_GET_ITEM(steps_um, instant)));
        PyObject *moved = PyTuple_New(p->modes);
        for (Py_ssize_t k = 0; k < p->modes && moved != NULL; k++)
            PyTuple_SET_ITEM(moved, k, PyComplex_FromDoubles(p->w_um[k][0], p->w_um[k][1]));
        PyList_SET_ITEM(found, instant, moved == NULL ? NULL : Py_BuildValue("NO", moved, limited ? Py_True : Py_False));
        p->shapes += n * p->points * p->modes;
        if (instant + 1 < instants)
            memcpy(table + 13 * n, table + 5 * n, (size_t)n * sizeof(double)); /* the weights */
    }
    if (PyErr_Occurred())
        Py_CLEAR(found);
    return found;
}

static PyObject *descend_over(const Py_buffer *given, PyObject *modal, PyObject *steps_um, Py_ssize_t iterations,
                              double uncertain_frac, double even_frac)
{
    Py_ssize_t size[ARRAYS];
    for (int index = 0; index < ARRAYS; index++)
        size[index] = given[index].len / (Py_ssize_t)sizeof(double);
    const double *curve = given[CURVE].buf;
    const Py_ssize_t instants = PyTuple_GET_SIZE(steps_um), q = size[WEIGHTS], m = size[LIMITS];
    const Py_ssize_t n = instants > 0 ? size[FINGERS] / (8 * instants) : 0;
    problem_t p = {.fingers = n, .points = q, .modes = m, .pieces = (size[CURVE] - 2) / 3, .is_point = q == 1};
    if (m > MOST_MODES || q < 1 || p.pieces < 1 || PyTuple_GET_SIZE(modal) != m || size[SHAPES] != instants * n * q * m) {
        PyErr_SetString(PyExc_ValueError, "felt_descent: the arrays' lengths do not fit");
        return NULL;
    }
    p.room = n * q + n * q % 2;
    p.shapes = given[SHAPES].buf, p.weights = given[WEIGHTS].buf, p.limits_um = given[LIMITS].buf;
    p.uncertain = p.is_point ? 0.0 : uncertain_frac * uncertain_frac, p.even = even_frac;
    p.full_um = curve[0], p.least = curve[1];
    p.starts_um = curve + 2, p.origins_um = p.starts_um + p.pieces, p.rates_1_um = p.origins_um + p.pieces;
    for (Py_ssize_t k = 0; k < m; k++) {
        const Py_complex w_um = PyComplex_AsCComplex(PyTuple_GET_ITEM(modal, k));
        p.w_um[k] = (pair_t){w_um.real, w_um.imag};
    }
    double *memory = PyMem_Malloc(own_size(&p) * sizeof(double));
    if (memory == NULL)
        return PyErr_NoMemory();
    PyObject *found = PyErr_Occurred() ? NULL : descend_along(&p, given[FINGERS].buf, steps_um, memory, iterations);
    PyMem_Free(memory);
    return found;
}

static PyObject *descend(PyObject *module, PyObject *arguments)
{
    (void)module;
    Py_buffer given[ARRAYS];
    PyObject *contacts, *modal, *steps_um, *answer = NULL;
    Py_ssize_t iterations;
    double uncertain_frac = UNCERTAIN_FRAC, even_frac = EVEN_FRAC;
    if (!PyArg_ParseTuple(arguments, "Oy*w*y*y*O!nO!|dd", &contacts, &given[1], &given[2], &given[3], &given[4],
                          &PyTuple_Type, &modal, &iterations, &PyTuple_Type, &steps_um, &uncertain_frac, &even_frac))
        return NULL;
    PyObject *shapes = PyTuple_Check(contacts) ? evaluate(NULL, contacts) : Py_NewRef(contacts);
    if (shapes != NULL && PyObject_GetBuffer(shapes, &given[SHAPES], PyBUF_SIMPLE) == 0) {
        answer = descend_over(given, modal, steps_um, iterations, uncertain_frac, even_frac);
        PyBuffer_Release(&given[SHAPES]);
    }
    Py_XDECREF(shapes);
    for (int index = WEIGHTS; index < ARRAYS; index++)
        PyBuffer_Release(&given[index]);
    return answer;
}

static PyMethodDef methods[] = {{"descend", descend, METH_VARARGS, "See felt_descent.pyi."}, {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "felt_descent", "The descent of `instant`.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit_felt_descent(void)
{
    PyObject *module = PyModule_Create(&definition);
    if (module != NULL && (PyModule_AddObject(module, "UNCERTAIN_FRAC", PyFloat_FromDouble(UNCERTAIN_FRAC)) < 0 ||
                           PyModule_AddObject(module, "EVEN_FRAC", PyFloat_FromDouble(EVEN_FRAC)) < 0 ||
                           PyModule_AddObject(module, "COLD", PyLong_FromLong(COLD)) < 0))
        Py_CLEAR(module);
    return module;
}
