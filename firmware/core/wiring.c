#include "wiring.h"

#include <string.h>

#include "limiter.h"

#define LEAST_PIVOT 0.02f /* of a matrix whose elements are of order 1: below, its inverse asks for absurd voltages */
#define LEAST_SHARE 0.2f  /* of the mode's strongest amplifier */

typedef hd_phasor_t matrix_t[HD_MODES][HD_MODES];

void hd_wiring_complete(hd_wiring_t *wiring)
{
    static const hd_wiring_t none;
    if (memcmp(wiring, &none, sizeof none) == 0) {
        for (int k = 0; k < HD_MODES; k++) {
            wiring->drive[k][k] = wiring->sense[k][k].d = 1.0f;
        }
    }
}

static void subtract_row(hd_phasor_t *row, const hd_phasor_t *pivot, hd_phasor_t factor)
{
    for (int n = 0; n < HD_MODES; n++) {
        row[n] = hd_sub(row[n], hd_mul(factor, pivot[n]));
    }
}

static void swap_rows(matrix_t of, int i, int j)
{
    hd_phasor_t row[HD_MODES];
    memcpy(row, of[i], sizeof row);
    memcpy(of[i], of[j], sizeof row);
    memcpy(of[j], row, sizeof row);
}

static int largest_in_column(const matrix_t of, int column)
{
    int best = column;
    for (int i = column + 1; i < HD_MODES; i++) {
        best = hd_dot(of[i][column], of[i][column]) > hd_dot(of[best][column], of[best][column]) ? i : best;
    }
    return best;
}

/* Gauss and Jordan, with the largest pivot of each column; false if one is too small, or not a number. */
static bool invert(const matrix_t of, matrix_t inverse)
{
    const hd_phasor_t one = {1.0f, 0.0f}, zero = {0.0f, 0.0f};
    matrix_t left;
    memcpy(left, of, sizeof left);
    memset(inverse, 0, sizeof left);
    for (int i = 0; i < HD_MODES; i++) {
        inverse[i][i] = one;
    }
    for (int i = 0; i < HD_MODES; i++) {
        int pivot = largest_in_column(left, i);
        swap_rows(left, i, pivot);
        swap_rows(inverse, i, pivot);
        if (!(hd_magnitude(left[i][i]) >= LEAST_PIVOT)) {
            return false;
        }
        hd_phasor_t scale = hd_sub(one, hd_div(one, left[i][i]));
        subtract_row(inverse[i], inverse[i], scale);
        subtract_row(left[i], left[i], scale);
        for (int j = 0; j < HD_MODES; j++) {
            hd_phasor_t factor = j == i ? zero : left[j][i];
            subtract_row(inverse[j], inverse[i], factor);
            subtract_row(left[j], left[i], factor);
        }
    }
    return true;
}

static bool invert_drive(const hd_wiring_t *wiring, matrix_t inverse)
{
    matrix_t drive;
    for (int i = 0; i < HD_MODES * HD_MODES; i++) {
        drive[i / HD_MODES][i % HD_MODES] = (hd_phasor_t){wiring->drive[i / HD_MODES][i % HD_MODES], 0.0f};
    }
    return invert(drive, inverse);
}

bool hd_wiring_valid(const hd_wiring_t *wiring)
{
    bool valid = true;
    for (int i = 0; i < HD_MODES; i++) {
        for (int j = 0; j < HD_MODES; j++) {
            valid = valid && fabsf(wiring->drive[i][j]) <= HD_DRIVE_SHARE_MAX
                && hd_within(wiring->sense[i][j], HD_SENSE_MAX)
                && hd_within(wiring->feedthrough_um_per_v[i][j], HD_FEEDTHROUGH_MAX_UM_PER_V);
        }
    }
    matrix_t inverse;
    return valid && invert_drive(wiring, inverse);
}

static float largest_share(const hd_wiring_t *wiring, int p)
{
    float largest = 0.0f;
    for (int k = 0; k < HD_MODES; k++) {
        largest = fmaxf(largest, fabsf(wiring->drive[k][p]));
    }
    return largest;
}

void hd_wiring_design(hd_wires_t *wires, const hd_wiring_t *wiring, const hd_phasor_t loop[HD_MODES])
{
    matrix_t inverse;
    invert_drive(wiring, inverse);
    if (!invert(wiring->sense, wires->sees)) {
        memset(wires->sees, 0, sizeof wires->sees);
    }
    hd_wiring_t own = {0};
    hd_wiring_complete(&own);
    wires->has_own_amplifiers = memcmp(own.drive, wiring->drive, sizeof own.drive) == 0;
    wires->has_own_sensors = memcmp(own.sense, wiring->sense, sizeof own.sense + sizeof own.feedthrough_um_per_v) == 0;
    for (int p = 0; p < HD_MODES; p++) {
        hd_phasor_t out = {loop[p].q, loop[p].d}, back = {loop[p].q, -loop[p].d}; /* j conj(loop), -j loop */
        float least = LEAST_SHARE * largest_share(wiring, p);
        uint32_t shares = 0;
        for (int k = 0; k < HD_MODES; k++) {
            wires->out[k][p] = hd_scale(wiring->drive[k][p], out);
            wires->back[p][k] = hd_scale(inverse[p][k].d, back);
            shares |= fabsf(wiring->drive[k][p]) >= least ? 1u << k : 0u;
        }
        wires->shares[p] = (uint8_t)shares;
    }
}

void hd_wiring_sense(const hd_wiring_t *wiring, const hd_phasor_t sensor_um[HD_MODES],
                     const hd_phasor_t mean_v[HD_MODES], hd_phasor_t mode_um[HD_MODES])
{
    for (int p = 0; p < HD_MODES; p++) {
        hd_phasor_t through_um = hd_row(wiring->feedthrough_um_per_v[p], mean_v);
        mode_um[p] = hd_sub(hd_row(wiring->sense[p], sensor_um), through_um);
    }
}

bool hd_wiring_drive(const hd_wires_t *wires, hd_phasor_t u_v[HD_MODES], float v_limit_v,
                     hd_phasor_t voltage_v[HD_MODES])
{
    bool reduced = false;
    for (int k = 0; k < HD_MODES; k++) {
        voltage_v[k] = wires->has_own_amplifiers ? hd_mul(wires->out[k][k], u_v[k]) : hd_row(wires->out[k], u_v);
        if (!hd_within(voltage_v[k], v_limit_v)) {
            voltage_v[k] = hd_shorten(voltage_v[k], v_limit_v);
            reduced = true;
        }
    }
    for (int p = 0; reduced && p < HD_MODES; p++) {
        u_v[p] = hd_row(wires->back[p], voltage_v);
    }
    return reduced;
}
