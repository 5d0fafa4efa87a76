/* Every finger feels a friction of 0.2, for 500 states of the plate or until the daemon ends. */
#include <stdio.h>

#include "hapticd.h"

int main(void) {
    hapticd *plate = hapticd_open(NULL, "study-7", 2.0);
    hapticd_state state;
    for (int n = 0; n < 500 && hapticd_error(plate)[0] == 0; n++) {
        if (hapticd_read(plate, &state, 1.0) != HAPTICD_OK) break;
        for (size_t i = 0; i < state.fingers; i++) {
            const hapticd_finger *finger = &state.finger[i];
            if (finger->owner[0] != 0) continue;
            printf("finger %u at %.1f, %.1f mm\n", (unsigned)finger->id, finger->x_mm, finger->y_mm);
            if (hapticd_set_friction(plate, finger->id, 0.2) != HAPTICD_OK) break;
        }
    }
    const int is_wrong = hapticd_error(plate)[0] != 0;
    fprintf(stderr, "%s\n", is_wrong ? hapticd_error(plate) : "500 states");
    hapticd_close(plate);
    return is_wrong;
}
