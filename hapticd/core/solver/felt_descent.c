/* The iteration of `felt.py` as machine code: felt_descent.py, translated line by line, to the last bit.
 *
 * Names and constants are explained there. The order of each sum is that of the Python, and the compiler may not fuse
 * products into sums (`build_ext.py`): tests/core/solver/test_felt_descent.py compares the bits of both. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <string.h>

static const double WEBER_FRAC = 0.11;
static const double UNCERTAIN_FRAC = 0.01;
static const double TO_ZERO[2] = {0.9, 0.97}, FIRST[2] = {0.7, 0.9};
static const double MOST_SLIPPERY = 0.9;
static const double RATE = 0.3;
static const double LEAST_JND = 0.02;
static const double MOST_WEIGHT = 4.6;
static const double ROUND_UM = 0.05;
static const double MOST_LESS = 1.5;
enum { SWEEPS = 4 };
static const double PAST_FRAC = 0.1;
static const double TINY_UM = 1e-9;
static const double SAFE = 1e100;

typedef struct {
    double w_d_um, w_q_um, rms_um, friction, decay_um;
} point_t;

typedef struct {
    Py_ssize_t fingers, points, modes, pieces;
    const double *shapes, *weights, *frictions, *stretches, *starts_um, *origins_um, *decays_um, *limits_um;
    double full_um, least;
    double *d_um, *q_um, *log_weights, *errors, *got, *logs, *curvature, *pull_d, *pull_q, *rms_um;
    point_t *moved;
} problem_t;

static point_t point(const problem_t *p, const double *row, double stretch)
{
    double w_d_um = 0.0, w_q_um = 0.0, uncertain = 0.0;
    for (Py_ssize_t k = 0; k < p->modes; k++) {
        w_d_um += row[k] * p->d_um[k];
        w_q_um += row[k] * p->q_um[k];
        uncertain += row[k] * row[k] * (p->d_um[k] * p->d_um[k] + p->q_um[k] * p->q_um[k]);
    }
    const double rms_um = sqrt(w_d_um * w_d_um + w_q_um * w_q_um + UNCERTAIN_FRAC * UNCERTAIN_FRAC * uncertain);
    const double at_um = rms_um / stretch;
    Py_ssize_t piece = 0;
    while (piece + 1 < p->pieces && at_um >= p->starts_um[piece + 1])
        piece++;
    const double decay_um = p->decays_um[piece];
    const double friction = at_um < p->full_um ? exp(-(at_um - p->origins_um[piece]) / decay_um) : p->least;
    return (point_t){w_d_um, w_q_um, rms_um, friction, decay_um * stretch};
}

static double share_of(double friction, const double *ends)
{
    const double share = (friction - ends[0]) / (ends[1] - ends[0]);
    return share < 0.0 ? 0.0 : (share > 1.0 ? 1.0 : share);
}

static void weigh(problem_t *p)
{
    double mean = 0.0, centre = 0.0;
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        double error = fabs(p->errors[finger]);
        error = error > LEAST_JND ? error : LEAST_JND;
        const double slipperiness = 1.0 - share_of(p->frictions[finger], FIRST);
        if (slipperiness * error > MOST_SLIPPERY)
            error = MOST_SLIPPERY / slipperiness;
        p->logs[finger] = log(error);
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

static void add_finger(problem_t *p, Py_ssize_t finger)
{
    const Py_ssize_t modes = p->modes;
    const double wanted = p->frictions[finger];
    const double alpha = exp(p->log_weights[finger]) / (WEBER_FRAC * wanted);
    const double stickiness = share_of(wanted, TO_ZERO);
    double outwards = (p->got[finger] - wanted) / p->got[finger];
    outwards = outwards > 1.0 ? 1.0 : (outwards < -MOST_LESS ? -MOST_LESS : outwards);
    for (Py_ssize_t index = 0; index < p->points; index++) {
        const point_t *at = &p->moved[finger * p->points + index];
        const double *row = &p->shapes[(finger * p->points + index) * modes];
        const double slope = alpha * p->weights[index] * at->friction / at->decay_um;
        const double to_zero = stickiness * slope / sqrt(at->rms_um * at->rms_um + ROUND_UM * ROUND_UM);
        const double along = (1.0 - stickiness) * slope / at->decay_um;
        double aim_um = at->rms_um + at->decay_um * outwards;
        aim_um = aim_um > 0.0 ? aim_um : 0.0;
        const double size_um = sqrt(at->w_d_um * at->w_d_um + at->w_q_um * at->w_q_um);
        const double pulled = along * aim_um / (size_um > TINY_UM ? size_um : TINY_UM);
        const double kappa = to_zero + along;
        for (Py_ssize_t k = 0; k < modes; k++) {
            const double share = kappa * row[k];
            double *line = &p->curvature[k * modes];
            for (Py_ssize_t other = 0; other < k; other++)
                line[other] = line[other] + share * row[other];
            line[k] = line[k] + (1.0 + UNCERTAIN_FRAC * UNCERTAIN_FRAC) * (share * row[k]);
            p->pull_d[k] = p->pull_d[k] + pulled * row[k] * at->w_d_um;
            p->pull_q[k] = p->pull_q[k] + pulled * row[k] * at->w_q_um;
        }
    }
}

static void sweep_mode(problem_t *p, Py_ssize_t k)
{
    const double *line = &p->curvature[k * p->modes];
    const double own = line[k], limit_um = p->limits_um[k];
    double rest_d = p->pull_d[k], rest_q = p->pull_q[k];
    for (Py_ssize_t other = 0; other < p->modes; other++) {
        rest_d -= line[other] * p->d_um[other];
        rest_q -= line[other] * p->q_um[other];
    }
    if (!(own > 0.0)) {
        p->d_um[k] = p->q_um[k] = 0.0;
        return;
    }
    double w_d_um = p->d_um[k] + (1.0 + PAST_FRAC) * (rest_d / own);
    double w_q_um = p->q_um[k] + (1.0 + PAST_FRAC) * (rest_q / own);
    const double square = w_d_um * w_d_um + w_q_um * w_q_um;
    if (!(square < SAFE * SAFE)) {
        w_d_um = w_q_um = 0.0;
    } else if (square > limit_um * limit_um) {
        const double share = limit_um / sqrt(square);
        w_d_um = w_d_um * share;
        w_q_um = w_q_um * share;
    }
    p->d_um[k] = w_d_um;
    p->q_um[k] = w_q_um;
}

static void sweep(problem_t *p, double stay_frac)
{
    const Py_ssize_t modes = p->modes;
    double mean = 0.0;
    for (Py_ssize_t k = 0; k < modes; k++)
        mean += p->curvature[k * modes + k] / (double)modes;
    const double stay = stay_frac * mean;
    for (Py_ssize_t k = 0; k < modes; k++) {
        for (Py_ssize_t other = 0; other < k; other++)
            p->curvature[other * modes + k] = p->curvature[k * modes + other];
        p->curvature[k * modes + k] = p->curvature[k * modes + k] + stay;
        p->pull_d[k] = p->pull_d[k] + stay * p->d_um[k];
        p->pull_q[k] = p->pull_q[k] + stay * p->q_um[k];
    }
    for (int turn = 0; turn < SWEEPS; turn++)
        for (Py_ssize_t k = 0; k < modes; k++)
            sweep_mode(p, k);
}

static void iterate(problem_t *p, double stay_frac)
{
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        p->got[finger] = 0.0;
        for (Py_ssize_t index = 0; index < p->points; index++) {
            const Py_ssize_t place = finger * p->points + index;
            p->moved[place] = point(p, &p->shapes[place * p->modes], p->stretches[finger]);
            p->got[finger] = p->got[finger] + p->weights[index] * p->moved[place].friction;
        }
        const double wanted = p->frictions[finger];
        p->errors[finger] = (p->got[finger] - wanted) / (WEBER_FRAC * wanted);
    }
    weigh(p);
    memset(p->curvature, 0, (size_t)(p->modes * p->modes + 2 * p->modes) * sizeof(double)); /* and both pulls */
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++)
        add_finger(p, finger);
    sweep(p, stay_frac);
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
        p->rms_um[finger] = sqrt(square);
    }
}

/* --- Python's lists and tuples ------------------------------------------------------------------------------------ */

/* Copies a sequence of `count` numbers; false with an exception if it is none. */
static int copy(PyObject *sequence, Py_ssize_t count, double *numbers, Py_ssize_t step)
{
    PyObject *fast = PySequence_Fast(sequence, "felt_descent: give lists or tuples of numbers");
    if (fast == NULL)
        return 0;
    int is_good = PySequence_Fast_GET_SIZE(fast) == count;
    if (!is_good)
        PyErr_SetString(PyExc_ValueError, "felt_descent: a list has another length");
    for (Py_ssize_t i = 0; i < count && is_good; i++) {
        numbers[i * step] = PyFloat_AsDouble(PySequence_Fast_GET_ITEM(fast, i));
        is_good = !(numbers[i * step] == -1.0 && PyErr_Occurred());
    }
    Py_DECREF(fast);
    return is_good;
}

static int copy_rows(PyObject *rows, Py_ssize_t count, Py_ssize_t width, double *numbers, Py_ssize_t across, Py_ssize_t down)
{
    if (PyList_GET_SIZE(rows) != count) {
        PyErr_SetString(PyExc_ValueError, "felt_descent: a list has another length");
        return 0;
    }
    for (Py_ssize_t i = 0; i < count; i++)
        if (!copy(PyList_GET_ITEM(rows, i), width, &numbers[i * down], across))
            return 0;
    return 1;
}

static int store(PyObject *list, Py_ssize_t count, const double *numbers)
{
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *number = PyFloat_FromDouble(numbers[i]);
        if (number == NULL || PyList_SetItem(list, i, number) < 0)
            return 0;
    }
    return 1;
}

static PyObject *listed(Py_ssize_t count, const double *numbers)
{
    PyObject *list = PyList_New(count);
    if (list != NULL && !store(list, count, numbers))
        Py_CLEAR(list);
    return list;
}

static PyObject *descend(PyObject *module, PyObject *arguments)
{
    (void)module;
    PyObject *shapes, *weights, *frictions, *stretches, *pieces, *limits, *d, *q, *log_weights, *answer = NULL;
    problem_t p;
    Py_ssize_t iterations;
    double stay_frac;
    if (!PyArg_ParseTuple(arguments, "O!O!O!O!O!(dd)O!O!O!O!nd", &PyList_Type, &shapes, &PyList_Type, &weights,
                          &PyList_Type, &frictions, &PyList_Type, &stretches, &PyList_Type, &pieces, &p.full_um, &p.least,
                          &PyTuple_Type, &limits, &PyList_Type, &d, &PyList_Type, &q, &PyList_Type, &log_weights,
                          &iterations, &stay_frac))
        return NULL;
    p.fingers = PyList_GET_SIZE(frictions), p.points = PyList_GET_SIZE(weights);
    p.modes = PyTuple_GET_SIZE(limits), p.pieces = PyList_GET_SIZE(pieces);
    const size_t n = (size_t)p.fingers, places = n * (size_t)p.points, m = (size_t)p.modes;
    const size_t numbers = places * m + (size_t)p.points + 7 * n + 3 * (size_t)p.pieces + m * m + 5 * m;
    double *memory = PyMem_Malloc((numbers + 1) * sizeof(double) + places * sizeof(point_t));
    if (memory == NULL)
        return PyErr_NoMemory();
    double *next = memory;
#define TAKE(count) (next += (count), next - (count))
    p.moved = (point_t *)TAKE(places * (sizeof(point_t) / sizeof(double)));
    double *shape = TAKE(places * m), *weight = TAKE((size_t)p.points), *friction = TAKE(n), *stretch = TAKE(n);
    double *piece = TAKE(3 * (size_t)p.pieces), *limit = TAKE(m);
    p.d_um = TAKE(m), p.q_um = TAKE(m), p.log_weights = TAKE(n), p.errors = TAKE(n), p.got = TAKE(n);
    p.logs = TAKE(n), p.rms_um = TAKE(n);
    p.curvature = TAKE(m * m), p.pull_d = TAKE(m), p.pull_q = TAKE(m);
#undef TAKE
    memset(p.errors, 0, n * sizeof(double));
    if (p.pieces > 0 && copy_rows(shapes, (Py_ssize_t)places, p.modes, shape, 1, p.modes) &&
        copy(weights, p.points, weight, 1) && copy(frictions, p.fingers, friction, 1) &&
        copy(stretches, p.fingers, stretch, 1) && copy_rows(pieces, p.pieces, 3, piece, p.pieces, 1) &&
        copy(limits, p.modes, limit, 1) && copy(d, p.modes, p.d_um, 1) && copy(q, p.modes, p.q_um, 1) &&
        copy(log_weights, p.fingers, p.log_weights, 1)) {
        p.shapes = shape, p.weights = weight, p.frictions = friction, p.stretches = stretch, p.limits_um = limit;
        p.starts_um = piece, p.origins_um = piece + p.pieces, p.decays_um = piece + 2 * p.pieces;
        for (Py_ssize_t turn = 0; turn < iterations; turn++)
            iterate(&p, stay_frac);
        measure(&p);
        if (store(d, p.modes, p.d_um) && store(q, p.modes, p.q_um) && store(log_weights, p.fingers, p.log_weights)) {
            PyObject *errors = listed(p.fingers, p.errors), *rms_um = listed(p.fingers, p.rms_um);
            if (errors != NULL && rms_um != NULL)
                answer = PyTuple_Pack(2, errors, rms_um);
            Py_XDECREF(errors);
            Py_XDECREF(rms_um);
        }
    } else if (!PyErr_Occurred()) {
        PyErr_SetString(PyExc_ValueError, "felt_descent: the friction curve has no pieces");
    }
    PyMem_Free(memory);
    return answer;
}

static PyMethodDef methods[] = {
    {"descend", descend, METH_VARARGS, "As `descend` of felt_descent.py."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "felt_descent", "felt_descent.py as machine code.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit_felt_descent(void)
{
    PyObject *module = PyModule_Create(&definition);
    if (module != NULL && PyModule_AddObject(module, "UNCERTAIN_FRAC", PyFloat_FromDouble(UNCERTAIN_FRAC)) < 0)
        Py_CLEAR(module);
    return module;
}
