/* Bicubic surfaces at points, and at the points of contacts: `bicubic.py` has the coefficients, `splines.pyi` the shapes
 * of the arrays.
 *
 * The compiler may not fuse products into sums: every machine gives the same bits. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <string.h>

enum { COEFFICIENTS = 16 }; /* of one surface in one cell, powers of y fastest */
enum { PATCHES, X, Y, DISC, GIVEN }; /* arrays */

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

/* The surfaces' tables; without any mode where lengths do not fit. */
static tables_t tables_of(const Py_buffer *given)
{
    tables_t t = {given[PATCHES].buf, given[X].buf, given[Y].buf, 0, doubles(&given[X]) - 1, doubles(&given[Y]) - 1};
    const Py_ssize_t patch = t.columns * t.rows * COEFFICIENTS;
    if (t.columns > 0 && t.rows > 0 && doubles(&given[PATCHES]) % patch == 0)
        t.modes = doubles(&given[PATCHES]) / patch;
    return t;
}

/* The surfaces at a point of the unit disc, of which a contact, x_mm, y_mm, xx_mm, xy_mm and yy_mm, is made. */
static void surfaces_in(const tables_t *t, const double *contact, const double *unit, double *next, Py_ssize_t width)
{
    surfaces_at(t, contact[0] + (contact[2] * unit[0] + contact[3] * unit[1]),
                contact[1] + (contact[3] * unit[0] + contact[4] * unit[1]), next, width);
}

static PyObject *lengths_do_not_fit(void)
{
    PyErr_SetString(PyExc_ValueError, "splines: the arrays' lengths do not fit");
    return NULL;
}

/* The first numbers of a tuple or a list; returns whether it has them. */
static int read_numbers(PyObject *from, Py_ssize_t count, double *numbers)
{
    if (!(PyTuple_Check(from) || PyList_Check(from)) || PySequence_Fast_GET_SIZE(from) < count)
        return 0;
    for (Py_ssize_t index = 0; index < count; index++)
        numbers[index] = PyFloat_AsDouble(PySequence_Fast_GET_ITEM(from, index));
    return !PyErr_Occurred();
}

/* The places are a list, or an array (N, 2) in `many`. */
static PyObject *evaluated(const Py_buffer *given, PyObject *places, const Py_buffer *many, PyObject *ellipses, double radius_mm,
                           Py_ssize_t width)
{
    const tables_t t = tables_of(given);
    const Py_ssize_t points = doubles(&given[DISC]) / 3, size = t.modes * width;
    const Py_ssize_t contacts = many == NULL ? PyList_GET_SIZE(places) : doubles(many) / 2;
    const int has_ellipses = ellipses != Py_None;
    int fits = t.modes > 0 && (!has_ellipses || (PyList_Check(ellipses) && PyList_GET_SIZE(ellipses) == contacts));
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, contacts * points * size * (Py_ssize_t)sizeof(double));
    double *next = bytes == NULL ? NULL : (double *)(void *)PyBytes_AS_STRING(bytes); /* aligned for them */
    for (Py_ssize_t contact = 0; fits && contact < contacts && next != NULL; contact++) {
        double own[] = {0.0, 0.0, radius_mm, 0.0, radius_mm};
        if (many != NULL)
            memcpy(own, (const double *)many->buf + 2 * contact, 2 * sizeof(double));
        else
            fits = read_numbers(PyList_GET_ITEM(places, contact), 2, own);
        if (has_ellipses && PyList_GET_ITEM(ellipses, contact) != Py_None)
            fits = fits && read_numbers(PyList_GET_ITEM(ellipses, contact), 3, own + 2);
        for (Py_ssize_t index = 0; fits && index < points; index++, next += size)
            surfaces_in(&t, own, (const double *)given[DISC].buf + 3 * index, next, width);
    }
    if (!fits) {
        Py_XDECREF(bytes);
        return PyErr_Occurred() ? NULL : lengths_do_not_fit();
    }
    return bytes;
}

/* `splines.evaluate`. */
static PyObject *evaluate(PyObject *module, PyObject *arguments)
{
    (void)module;
    Py_buffer given[GIVEN], many;
    PyObject *places, *ellipses, *answer = NULL;
    double radius_mm;
    int has_slopes = 0;
    if (!PyArg_ParseTuple(arguments, "(y*y*y*)y*OOd|p", &given[PATCHES], &given[X], &given[Y], &given[DISC], &places, &ellipses,
                          &radius_mm, &has_slopes))
        return NULL;
    if (PyList_Check(places)) {
        answer = evaluated(given, places, NULL, ellipses, radius_mm, has_slopes ? 3 : 1);
    } else if (PyObject_GetBuffer(places, &many, PyBUF_C_CONTIGUOUS) == 0) {
        answer = evaluated(given, NULL, &many, ellipses, radius_mm, has_slopes ? 3 : 1);
        PyBuffer_Release(&many);
    }
    for (int index = 0; index < GIVEN; index++)
        PyBuffer_Release(&given[index]);
    return answer;
}
