/* The calls of test_contract_of_languages.py in C: directory and name of the client are its arguments. */
#include "hapticd.h"

#include <math.h>
#include <stdio.h>

static int expect(hapticd *plate, int code, const char *what) {
    if (code == HAPTICD_OK) return 0;
    fprintf(stderr, "%s: %s\n", what, hapticd_error(plate));
    return 1;
}

int main(int count, char **words) {
    if (count != 3) return 2;
    hapticd *plate = hapticd_open(words[1], words[2], 30.0);
    if (plate == NULL || hapticd_error(plate)[0] != 0) {
        fprintf(stderr, "%s\n", hapticd_error(plate));
        hapticd_close(plate);
        return 1;
    }
    hapticd_grating grating = {4.0, 2.0, 0.5, 0.25, 0.5};
    hapticd_surface patch = hapticd_new_surface(), disc = hapticd_new_surface();
    patch.amplitude_um = 1.25;
    patch.rectangle_mm[0] = 40.0;
    patch.rectangle_mm[1] = 20.0;
    patch.position_mm[0] = 10.0;
    patch.position_mm[1] = -5.0;
    patch.angle_rad = 0.5;
    patch.z = 3;
    disc.friction = 0.1;
    disc.circle_mm = 8.0;
    uint64_t t_ns = 0;
    hapticd_state state;
    int failed = expect(plate, hapticd_set_friction(plate, 1, 0.2), "friction") ||
                 expect(plate, hapticd_set_grating(plate, 2, &grating), "grating") ||
                 expect(plate, hapticd_lay_surface(plate, "patch", &patch), "patch") ||
                 expect(plate, hapticd_lay_surface(plate, "disc", &disc), "disc") ||
                 expect(plate, hapticd_marker(plate, "trial 1", 0, &t_ns), "marker");
    if (!failed && t_ns == 0) failed = 1;
    if (!failed && hapticd_set_friction(plate, 1, 1.5) != HAPTICD_REFUSED) failed = 1;
    if (!failed) printf("refused: %s\n", hapticd_error(plate));
    for (int i = 0; i < 100 && !failed; i++) failed = expect(plate, hapticd_read(plate, &state, 10.0), "read");
    if (!failed) {
        printf("fingers:");
        for (size_t i = 0; i < state.fingers; i++)
            printf(" %u %g %g %d", (unsigned)state.finger[i].id, state.finger[i].x_mm, state.finger[i].y_mm,
                   !isnan(state.finger[i].target_um));
        printf("\n");
        failed = expect(plate, hapticd_release(plate, 1), "release") ||
                 expect(plate, hapticd_remove_surface(plate, "patch"), "remove");
    }
    hapticd_close(plate);
    return failed;
}
