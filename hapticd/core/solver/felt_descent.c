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
static const double TO_ZERO[2] = {0.9, 0.97};
static const double RATE = 0.3;
static const double LEAST_JND = 0.02;
static const double MOST_WEIGHT = 4.6;
static const double ROUND_UM = 0.05;
static const double MOST_LESS = 1.5;
enum { SWEEPS = 4 };
static const double PAST_FRAC = 0.1;
static const double TINY_UM = 1e-9;
static const double SAFE = 1e100;
static const double INSIDE = 1.0 - 0x1p-50;
enum { COEFFICIENTS = 16 }; /* of one surface in one cell: bicubic.py */

typedef struct {
    double w_d_um, w_q_um, rms_um, friction;
    Py_ssize_t piece;
} point_t;

typedef struct {
    Py_ssize_t fingers, points, modes, pieces;
    const double *shapes, *weights, *frictions, *counted, *stretches, *starts_um, *origins_um, *decays_um, *limits_um;
    double full_um, least;
    double *d_um, *q_um, *log_weights, *errors, *got, *logs, *curvature, *pull_d, *pull_q, *rms_um, *squares, *shares, *rates_1_um;
    point_t *moved;
} problem_t;

static point_t point(const problem_t *p, const double *row, double share)
{
    double w_d_um = 0.0, w_q_um = 0.0, uncertain = 0.0;
    for (Py_ssize_t k = 0; k < p->modes; k++) {
        w_d_um += row[k] * p->d_um[k];
        w_q_um += row[k] * p->q_um[k];
        uncertain += row[k] * row[k] * p->squares[k];
    }
    const double rms_um = sqrt(w_d_um * w_d_um + w_q_um * w_q_um + UNCERTAIN_FRAC * UNCERTAIN_FRAC * uncertain);
    const double at_um = rms_um * share;
    Py_ssize_t piece = 0;
    while (piece + 1 < p->pieces && at_um >= p->starts_um[piece + 1])
        piece++;
    const double friction =
        at_um < p->full_um ? exp((p->origins_um[piece] - at_um) * p->rates_1_um[piece]) : p->least;
    return (point_t){w_d_um, w_q_um, rms_um, friction, piece};
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

static void add_finger(problem_t *p, Py_ssize_t finger)
{
    const Py_ssize_t modes = p->modes;
    const double wanted = p->frictions[finger];
    const double alpha = exp(p->log_weights[finger]) / (WEBER_FRAC * wanted);
    const double stickiness = share_of(wanted, TO_ZERO);
    double outwards = (p->got[finger] - wanted) / p->got[finger];
    const double stretch = p->stretches[finger], share = 1.0 / stretch;
    outwards = outwards > 1.0 ? 1.0 : (outwards < -MOST_LESS ? -MOST_LESS : outwards);
    for (Py_ssize_t index = 0; index < p->points; index++) {
        const point_t *at = &p->moved[finger * p->points + index];
        const double *row = &p->shapes[(finger * p->points + index) * modes];
        const double rate_1_um = p->rates_1_um[at->piece] * share;
        const double slope = alpha * p->weights[index] * at->friction * rate_1_um;
        double kappa = 0.0, pulled = 0.0;
        if (stickiness > 0.0)
            kappa = stickiness * slope / sqrt(at->rms_um * at->rms_um + ROUND_UM * ROUND_UM);
        if (stickiness < 1.0) {
            const double along = (1.0 - stickiness) * slope * rate_1_um;
            double aim_um = at->rms_um + p->decays_um[at->piece] * stretch * outwards;
            aim_um = aim_um > 0.0 ? aim_um : 0.0;
            const double size_um = sqrt(at->w_d_um * at->w_d_um + at->w_q_um * at->w_q_um);
            pulled = along * aim_um / (size_um > TINY_UM ? size_um : TINY_UM);
            kappa += along;
        }
        const double towards_d = pulled * at->w_d_um, towards_q = pulled * at->w_q_um;
        for (Py_ssize_t k = 0; k < modes; k++) {
            const double part = kappa * row[k];
            double *line = &p->curvature[k * modes];
            for (Py_ssize_t other = 0; other <= k; other++)
                line[other] = line[other] + part * row[other];
            p->pull_d[k] = p->pull_d[k] + towards_d * row[k];
            p->pull_q[k] = p->pull_q[k] + towards_q * row[k];
        }
    }
}

static void sweep_mode(problem_t *p, Py_ssize_t k)
{
    if (!(p->shares[k] > 0.0)) {
        p->d_um[k] = p->q_um[k] = 0.0;
        return;
    }
    const double *line = &p->curvature[k * p->modes];
    const double limit_um = p->limits_um[k];
    double w_d_um = p->pull_d[k], w_q_um = p->pull_q[k];
    for (Py_ssize_t other = 0; other < p->modes; other++) {
        w_d_um -= line[other] * p->d_um[other];
        w_q_um -= line[other] * p->q_um[other];
    }
    const double square = w_d_um * w_d_um + w_q_um * w_q_um;
    if (!(square < SAFE * SAFE)) {
        w_d_um = w_q_um = 0.0;
    } else if (square > INSIDE * limit_um * limit_um) {
        const double share = INSIDE * limit_um / sqrt(square);
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
    for (Py_ssize_t k = 0; k < modes; k++)
        for (Py_ssize_t other = 0; other < k; other++)
            p->curvature[other * modes + k] = p->curvature[k * modes + other];
    for (Py_ssize_t k = 0; k < modes; k++) {
        double *line = &p->curvature[k * modes];
        const double own = (1.0 + UNCERTAIN_FRAC * UNCERTAIN_FRAC) * line[k] + stay;
        p->shares[k] = own > 0.0 ? (1.0 + PAST_FRAC) / own : 0.0;
        p->pull_d[k] = p->shares[k] * (p->pull_d[k] + stay * p->d_um[k]);
        p->pull_q[k] = p->shares[k] * (p->pull_q[k] + stay * p->q_um[k]);
        for (Py_ssize_t other = 0; other < modes; other++)
            line[other] = p->shares[k] * line[other];
        line[k] = PAST_FRAC;
    }
    for (int turn = 0; turn < SWEEPS; turn++)
        for (Py_ssize_t k = 0; k < modes; k++)
            sweep_mode(p, k);
}

static void iterate(problem_t *p, double stay_frac)
{
    for (Py_ssize_t k = 0; k < p->modes; k++)
        p->squares[k] = p->d_um[k] * p->d_um[k] + p->q_um[k] * p->q_um[k];
    for (Py_ssize_t finger = 0; finger < p->fingers; finger++) {
        const double share = 1.0 / p->stretches[finger];
        p->got[finger] = 0.0;
        for (Py_ssize_t index = 0; index < p->points; index++) {
            const Py_ssize_t place = finger * p->points + index;
            p->moved[place] = point(p, &p->shapes[place * p->modes], share);
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
    const double *c = &t->patches[(row * t->columns + column) * t->modes * COEFFICIENTS];
    for (Py_ssize_t k = 0; k < t->modes; k++, c += COEFFICIENTS) {
        double along[4];
        for (int power = 0; power < 4; power++)
            along[power] = ((c[4 * power + 3] * u + c[4 * power + 2]) * u + c[4 * power + 1]) * u + c[4 * power];
        shapes[k] = ((along[3] * v + along[2]) * v + along[1]) * v + along[0];
    }
}

/* --- Python's lists and tuples ------------------------------------------------------------------------------------ */

/* A view of an array of doubles, contiguous; false with an exception if it is none. */
static int view(PyObject *object, int dimensions, Py_buffer *found)
{
    if (PyObject_GetBuffer(object, found, PyBUF_ND | PyBUF_FORMAT) < 0)
        return 0;
    if (found->ndim == dimensions && strcmp(found->format, "d") == 0)
        return 1;
    PyBuffer_Release(found);
    PyErr_SetString(PyExc_ValueError, "felt_descent: a map's table is no such array of doubles");
    return 0;
}

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

/* The numbers in a bytes object, whose storage is aligned for them. */
static double *doubles_of(PyObject *bytes)
{
    return (double *)(void *)PyBytes_AS_STRING(bytes);
}

/* The shapes at all points, as bytes; `disc` and `contacts` are lists of tuples. */
static PyObject *filled(const tables_t *t, PyObject *disc, PyObject *contacts)
{
    const Py_ssize_t points = PyList_GET_SIZE(disc), fingers = PyList_GET_SIZE(contacts);
    const Py_ssize_t size = fingers * points * t->modes * (Py_ssize_t)sizeof(double);
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, size);
    double *unit = PyMem_Malloc(((size_t)points * 3 + 1) * sizeof(double));
    if (bytes == NULL || unit == NULL || !copy_rows(disc, points, 3, unit, 1, 3))
        goto failed;
    double *next = doubles_of(bytes);
    for (Py_ssize_t finger = 0; finger < fingers; finger++) {
        double ellipse[5];
        if (!copy(PyList_GET_ITEM(contacts, finger), 5, ellipse, 1))
            goto failed;
        for (Py_ssize_t index = 0; index < points; index++, next += t->modes) {
            const double u = unit[3 * index], v = unit[3 * index + 1];
            shapes_at(t, ellipse[0] + (ellipse[2] * u + ellipse[3] * v), ellipse[1] + (ellipse[3] * u + ellipse[4] * v), next);
        }
    }
    PyMem_Free(unit);
    return bytes;
failed:
    if (unit == NULL)
        PyErr_NoMemory();
    PyMem_Free(unit);
    Py_XDECREF(bytes);
    return NULL;
}

static PyObject *descend(PyObject *module, PyObject *arguments)
{
    (void)module;
    PyObject *shapes, *weights, *frictions, *counted, *stretches, *pieces, *limits, *d, *q, *log_weights, *answer = NULL;
    problem_t p;
    Py_ssize_t iterations;
    double stay_frac;
    if (!PyArg_ParseTuple(arguments, "SO!O!O!O!O!(dd)O!O!O!O!nd", &shapes, &PyList_Type, &weights,
                          &PyList_Type, &frictions, &PyList_Type, &counted, &PyList_Type, &stretches,
                          &PyList_Type, &pieces, &p.full_um, &p.least,
                          &PyTuple_Type, &limits, &PyList_Type, &d, &PyList_Type, &q, &PyList_Type, &log_weights,
                          &iterations, &stay_frac))
        return NULL;
    p.fingers = PyList_GET_SIZE(frictions), p.points = PyList_GET_SIZE(weights);
    p.modes = PyTuple_GET_SIZE(limits), p.pieces = PyList_GET_SIZE(pieces);
    const size_t n = (size_t)p.fingers, places = n * (size_t)p.points, m = (size_t)p.modes;
    const size_t numbers = (size_t)p.points + 8 * n + 4 * (size_t)p.pieces + m * m + 7 * m;
    if (PyBytes_GET_SIZE(shapes) != (Py_ssize_t)(places * m * sizeof(double))) {
        PyErr_SetString(PyExc_ValueError, "felt_descent: the shapes have another length");
        return NULL;
    }
    double *memory = PyMem_Malloc((numbers + 1) * sizeof(double) + places * sizeof(point_t));
    if (memory == NULL)
        return PyErr_NoMemory();
    double *next = memory;
#define TAKE(count) (next += (count), next - (count))
    p.moved = (point_t *)TAKE(places * (sizeof(point_t) / sizeof(double)));
    double *weight = TAKE((size_t)p.points), *friction = TAKE(n), *count = TAKE(n), *stretch = TAKE(n);
    double *piece = TAKE(3 * (size_t)p.pieces), *rate = TAKE((size_t)p.pieces), *limit = TAKE(m);
    p.d_um = TAKE(m), p.q_um = TAKE(m), p.log_weights = TAKE(n), p.errors = TAKE(n), p.got = TAKE(n);
    p.logs = TAKE(n), p.rms_um = TAKE(n);
    p.curvature = TAKE(m * m), p.pull_d = TAKE(m), p.pull_q = TAKE(m), p.squares = TAKE(m), p.shares = TAKE(m);
#undef TAKE
    memset(p.errors, 0, n * sizeof(double));
    if (p.pieces > 0 && copy(weights, p.points, weight, 1) && copy(frictions, p.fingers, friction, 1) &&
        copy(counted, p.fingers, count, 1) && copy(stretches, p.fingers, stretch, 1) && copy_rows(pieces, p.pieces, 3, piece, p.pieces, 1) &&
        copy(limits, p.modes, limit, 1) && copy(d, p.modes, p.d_um, 1) && copy(q, p.modes, p.q_um, 1) &&
        copy(log_weights, p.fingers, p.log_weights, 1)) {
        p.shapes = doubles_of(shapes), p.weights = weight, p.frictions = friction, p.counted = count;
        p.stretches = stretch, p.limits_um = limit;
        p.starts_um = piece, p.origins_um = piece + p.pieces, p.decays_um = piece + 2 * p.pieces;
        for (Py_ssize_t i = 0; i < p.pieces; i++)
            rate[i] = 1.0 / p.decays_um[i];
        p.rates_1_um = rate;
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

static PyObject *contact_shapes(PyObject *module, PyObject *arguments)
{
    (void)module;
    PyObject *modes, *disc, *contacts, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "OO!O!", &modes, &PyList_Type, &disc, &PyList_Type, &contacts))
        return NULL;
    PyObject *tables = PyObject_GetAttrString(modes, "tables"), *patches, *x, *y;
    Py_buffer patch, column, row;
    if (tables == NULL || !PyArg_ParseTuple(tables, "OOO", &patches, &x, &y) || !view(patches, 3, &patch))
        goto no_tables;
    if (!view(x, 1, &column))
        goto no_columns;
    if (!view(y, 1, &row))
        goto no_rows;
    const tables_t t = {patch.buf, column.buf, row.buf, patch.shape[1], column.shape[0] - 1, row.shape[0] - 1};
    answer = filled(&t, disc, contacts);
    PyBuffer_Release(&row);
no_rows:
    PyBuffer_Release(&column);
no_columns:
    PyBuffer_Release(&patch);
no_tables:
    Py_XDECREF(tables);
    return answer;
}

static PyObject *contacts_rms_um(PyObject *module, PyObject *arguments)
{
    (void)module;
    PyObject *shapes, *weights, *d, *q, *answer = NULL;
    if (!PyArg_ParseTuple(arguments, "SO!O!O!", &shapes, &PyList_Type, &weights, &PyList_Type, &d, &PyList_Type, &q))
        return NULL;
    problem_t p = {.points = PyList_GET_SIZE(weights), .modes = PyList_GET_SIZE(d), .shapes = doubles_of(shapes)};
    const Py_ssize_t numbers = PyBytes_GET_SIZE(shapes) / (Py_ssize_t)sizeof(double), contact = p.points * p.modes;
    p.fingers = contact > 0 ? numbers / contact : 0;
    double *memory = PyMem_Malloc((size_t)(p.points + 2 * p.modes + p.fingers + 1) * sizeof(double));
    if (memory != NULL) {
        p.d_um = memory + p.points, p.q_um = p.d_um + p.modes, p.rms_um = p.q_um + p.modes, p.weights = memory;
        if (copy(weights, p.points, memory, 1) && copy(d, p.modes, p.d_um, 1) && copy(q, p.modes, p.q_um, 1)) {
            measure(&p);
            answer = listed(p.fingers, p.rms_um);
        }
        PyMem_Free(memory);
    } else {
        PyErr_NoMemory();
    }
    return answer;
}

static PyMethodDef methods[] = {
    {"descend", descend, METH_VARARGS, "As `descend` of felt_descent.py."},
    {"contact_shapes", contact_shapes, METH_VARARGS, "As `contact_shapes` of felt_descent.py."},
    {"contacts_rms_um", contacts_rms_um, METH_VARARGS, "As `contacts_rms_um` of felt_descent.py."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "felt_descent", "felt_descent.py as machine code.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit_felt_descent(void)
{
    PyObject *module = PyModule_Create(&definition);
    if (module != NULL && (PyModule_AddObject(module, "UNCERTAIN_FRAC", PyFloat_FromDouble(UNCERTAIN_FRAC)) < 0 ||
                           PyModule_AddObject(module, "MOST_WEIGHT", PyFloat_FromDouble(MOST_WEIGHT)) < 0))
        Py_CLEAR(module);
    return module;
}
