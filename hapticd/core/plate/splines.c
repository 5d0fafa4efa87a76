/* What contacts feel on bicubic surfaces; `splines.pyi` has the shapes of the arrays. */

#include "surfaces.h"

enum { CURVE = GIVEN };
enum { MOST_MODES = 16 }; /* whose vibration is felt */

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

typedef struct {
    double contact[5], modal_um[2 * MOST_MODES], speed_gain, map_frac, sensors_frac;
} felt_t;

static PyObject *perceived(const Py_buffer *given, const felt_t *at)
{
    const tables_t t = tables_of(given);
    double felt = 0.0, known_um2 = 0.0, errors_um2 = 0.0, mean_d_um = 0.0, mean_q_um = 0.0, all_um2 = 0.0, shapes[MOST_MODES];
    for (Py_ssize_t part = 0; part < 2 * t.modes; part++)
        all_um2 += at->modal_um[part] * at->modal_um[part];
    const double fixed_um2 = at->map_frac * at->map_frac * all_um2, each_um2 = at->sensors_frac * at->sensors_frac * all_um2;
    const double *unit = given[DISC].buf, *end = unit + doubles(&given[DISC]) / 3 * 3;
    for (; unit < end; unit += 3) {
        double d_um = 0.0, q_um = 0.0, squares = 0.0;
        surfaces_in(&t, at->contact, unit, shapes, 1);
        for (Py_ssize_t k = 0; k < t.modes; k++) {
            d_um += shapes[k] * at->modal_um[2 * k];
            q_um += shapes[k] * at->modal_um[2 * k + 1];
            squares += shapes[k] * shapes[k];
        }
        const double size_um2 = d_um * d_um + q_um * q_um, error_um2 = fixed_um2 + squares * each_um2;
        felt += unit[2] * friction(&given[CURVE], sqrt(size_um2 + MEAN_FRAC * error_um2) / at->speed_gain);
        known_um2 += unit[2] * size_um2;
        errors_um2 += unit[2] * error_um2;
        mean_d_um += unit[2] * d_um;
        mean_q_um += unit[2] * q_um;
    }
    return Py_BuildValue("ddddd", felt, known_um2, errors_um2, mean_d_um, mean_q_um);
}

static PyObject *perceive(PyObject *module, PyObject *arguments)
{
    (void)module;
    Py_buffer given[GIVEN + 1];
    PyObject *modal, *answer = NULL;
    felt_t at;
    double *c = at.contact;
    if (!PyArg_ParseTuple(arguments, "(y*y*y*)y*(ddddd)O!y*ddd", &given[PATCHES], &given[X], &given[Y], &given[DISC], &c[0], &c[1],
                          &c[2], &c[3], &c[4], &PyTuple_Type, &modal, &given[CURVE], &at.speed_gain, &at.map_frac,
                          &at.sensors_frac))
        return NULL;
    const Py_ssize_t modes = PyTuple_GET_SIZE(modal);
    const int fits = modes <= MOST_MODES && modes > 0 && tables_of(given).modes == modes && doubles(&given[CURVE]) >= 5;
    for (Py_ssize_t k = 0; fits && k < modes; k++) {
        const Py_complex w_um = PyComplex_AsCComplex(PyTuple_GET_ITEM(modal, k));
        at.modal_um[2 * k] = w_um.real, at.modal_um[2 * k + 1] = w_um.imag;
    }
    if (!PyErr_Occurred())
        answer = fits ? perceived(given, &at) : lengths_do_not_fit();
    for (int index = 0; index <= GIVEN; index++)
        PyBuffer_Release(&given[index]);
    return answer;
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
