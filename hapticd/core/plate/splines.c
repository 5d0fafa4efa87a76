/* Bicubic surfaces at points, and what contacts there feel: `bicubic.py` has the coefficients, `splines.pyi` the shapes
 * of the arrays.
 *
 * The compiler may not fuse products into sums: every machine gives the same bits. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <string.h>

enum { COEFFICIENTS = 16 }; /* of one surface in one cell, powers of y fastest */

typedef double pair_t __attribute__((vector_size(2 * sizeof(double)), aligned(sizeof(double)))); /* two powers of y */

typedef struct {
    const double *patches, *x_mm, *y_mm;
    Py_ssize_t modes, columns, rows; /* cells */
} tables_t;

typedef struct {
    Py_ssize_t cell;
    double offset_mm;
    int is_on_map;
} place_t;

/* The interval of a coordinate, or of the edge that is nearest: at once on an even grid. */
static place_t located(const double *knots_mm, Py_ssize_t cells, double asked_mm)
{
    const double first_mm = knots_mm[0], last_mm = knots_mm[cells];
    const double at_mm = asked_mm < first_mm ? first_mm : (asked_mm > last_mm ? last_mm : asked_mm);
    const double guess = (at_mm - first_mm) * ((double)cells / (last_mm - first_mm));
    Py_ssize_t cell = guess < (double)cells ? (Py_ssize_t)guess : cells - 1;
    while (cell > 0 && at_mm < knots_mm[cell])
        cell--;
    while (cell + 1 < cells && at_mm >= knots_mm[cell + 1])
        cell++;
    return (place_t){cell, at_mm - knots_mm[cell], at_mm == asked_mm};
}

/* `width` numbers of each surface: 1 for its value, 3 with the slopes, which are 0 across the edge beyond the map. */
static void surfaces_at(const tables_t *t, double x_mm, double y_mm, double *next, Py_ssize_t width)
{
    if (isnan(x_mm) || isnan(y_mm)) {
        memset(next, 0, (size_t)(t->modes * width) * sizeof(double));
        return;
    }
    const place_t x = located(t->x_mm, t->columns, x_mm), y = located(t->y_mm, t->rows, y_mm);
    const double u = x.offset_mm, v = y.offset_mm;
    const pair_t *c = (const pair_t *)&t->patches[(y.cell * t->columns + x.cell) * t->modes * COEFFICIENTS];
    for (Py_ssize_t k = 0; k < t->modes; k++, c += COEFFICIENTS / 2, next += width) {
        const pair_t low = ((c[6] * u + c[4]) * u + c[2]) * u + c[0], high = ((c[7] * u + c[5]) * u + c[3]) * u + c[1];
        next[0] = ((high[1] * v + high[0]) * v + low[1]) * v + low[0];
        if (width == 1)
            continue;
        const pair_t low_x = (3.0 * c[6] * u + 2.0 * c[4]) * u + c[2], high_x = (3.0 * c[7] * u + 2.0 * c[5]) * u + c[3];
        next[1] = x.is_on_map ? ((high_x[1] * v + high_x[0]) * v + low_x[1]) * v + low_x[0] : 0.0;
        next[2] = y.is_on_map ? (3.0 * high[1] * v + 2.0 * high[0]) * v + low[1] : 0.0;
    }
}

static Py_ssize_t doubles(const Py_buffer *buffer)
{
    return buffer->len / (Py_ssize_t)sizeof(double);
}

static PyObject *evaluated(const Py_buffer *given, Py_ssize_t width)
{
    enum { PATCHES, X, Y, DISC, CONTACTS };
    tables_t t = {given[PATCHES].buf, given[X].buf, given[Y].buf, 0, doubles(&given[X]) - 1, doubles(&given[Y]) - 1};
    const Py_ssize_t patch = t.columns * t.rows * COEFFICIENTS, points = doubles(&given[DISC]) / 3;
    if (t.columns < 1 || t.rows < 1 || doubles(&given[PATCHES]) % patch != 0 || doubles(&given[CONTACTS]) % 5 != 0) {
        PyErr_SetString(PyExc_ValueError, "splines: the arrays' lengths do not fit");
        return NULL;
    }
    t.modes = doubles(&given[PATCHES]) / patch;
    const Py_ssize_t contacts = doubles(&given[CONTACTS]) / 5, size = t.modes * width;
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, contacts * points * size * (Py_ssize_t)sizeof(double));
    double *next = bytes == NULL ? NULL : (double *)(void *)PyBytes_AS_STRING(bytes); /* aligned for them */
    for (Py_ssize_t contact = 0; contact < contacts && next != NULL; contact++) {
        const double *ellipse = (const double *)given[CONTACTS].buf + 5 * contact, *unit = given[DISC].buf;
        for (Py_ssize_t index = 0; index < points; index++, unit += 3, next += size)
            surfaces_at(&t, ellipse[0] + (ellipse[2] * unit[0] + ellipse[3] * unit[1]),
                        ellipse[1] + (ellipse[3] * unit[0] + ellipse[4] * unit[1]), next, width);
    }
    return bytes;
}

static PyObject *evaluate(PyObject *module, PyObject *arguments)
{
    (void)module;
    Py_buffer given[5];
    int has_slopes;
    if (!PyArg_ParseTuple(arguments, "(y*y*y*)y*y*p", &given[0], &given[1], &given[2], &given[3], &given[4], &has_slopes))
        return NULL;
    PyObject *answer = evaluated(given, has_slopes ? 3 : 1);
    for (int index = 0; index < 5; index++)
        PyBuffer_Release(&given[index]);
    return answer;
}

static const double MEAN_FRAC = 0.785; /* pi / 4, of the square of an error in both parts: the square of its mean size */

/* Friction at an amplitude of a finger at rest, by a `FrictionCurve.table`. */
static double friction(const Py_buffer *curve, double at_um)
{
    const Py_ssize_t pieces = (doubles(curve) - 2) / 3;
    const double *ends = curve->buf, *starts_um = ends + 2, *origins_um = starts_um + pieces;
    Py_ssize_t piece = 0;
    while (piece + 1 < pieces && at_um >= starts_um[piece + 1])
        piece++;
    return at_um < ends[0] ? exp((origins_um[piece] - at_um) * origins_um[pieces + piece]) : ends[1];
}

static PyObject *perceive(PyObject *module, PyObject *arguments)
{
    enum { SHAPES, DISC, MODAL, CURVE };
    (void)module;
    Py_buffer given[4];
    double speed_gain, fixed_um2, each_um2, felt = 0.0, known_um2 = 0.0, errors_um2 = 0.0, mean_d_um = 0.0, mean_q_um = 0.0;
    if (!PyArg_ParseTuple(arguments, "y*y*y*y*ddd", &given[0], &given[1], &given[2], &given[3], &speed_gain, &fixed_um2, &each_um2))
        return NULL;
    const Py_ssize_t points = doubles(&given[DISC]) / 3, modes = doubles(&given[MODAL]) / 2;
    const int fits = doubles(&given[SHAPES]) == points * modes && doubles(&given[CURVE]) >= 5;
    const double *row = given[SHAPES].buf, *modal_um = given[MODAL].buf, *unit = given[DISC].buf;
    for (Py_ssize_t index = 0; fits && index < points; index++, row += modes, unit += 3) {
        double d_um = 0.0, q_um = 0.0, squares = 0.0;
        for (Py_ssize_t k = 0; k < modes; k++) {
            d_um += row[k] * modal_um[2 * k];
            q_um += row[k] * modal_um[2 * k + 1];
            squares += row[k] * row[k];
        }
        const double size_um2 = d_um * d_um + q_um * q_um, error_um2 = fixed_um2 + squares * each_um2;
        felt += unit[2] * friction(&given[CURVE], sqrt(size_um2 + MEAN_FRAC * error_um2) / speed_gain);
        known_um2 += unit[2] * size_um2;
        errors_um2 += unit[2] * error_um2;
        mean_d_um += unit[2] * d_um;
        mean_q_um += unit[2] * q_um;
    }
    for (int index = 0; index < 4; index++)
        PyBuffer_Release(&given[index]);
    if (fits)
        return Py_BuildValue("ddddd", felt, known_um2, errors_um2, mean_d_um, mean_q_um);
    PyErr_SetString(PyExc_ValueError, "splines: the arrays' lengths do not fit");
    return NULL;
}

static PyMethodDef methods[] = {
    {"evaluate", evaluate, METH_VARARGS, "See splines.pyi."},
    {"perceive", perceive, METH_VARARGS, "See splines.pyi."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "splines", "Bicubic surfaces at points.", -1, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit_splines(void)
{
    return PyModule_Create(&definition);
}
