/* Hostile bytes for the readers of hapticd.c: each line of the input is one message in hexadecimal. */
#include "hapticd.c"

int main(void) {
    static char line[4 * MAX_BYTES];
    hapticd plate = {0};
    unsigned long messages = 0, states = 0;
    while (fgets(line, sizeof line, stdin) != NULL) {
        size_t length = strcspn(line, "\n") / 2;
        uint8_t *bytes = malloc(length > 0 ? length : 1); /* of just this size: ASan sees a byte too many */
        for (size_t i = 0; i < length; i++) {
            unsigned one = 0;
            if (sscanf(line + 2 * i, "%2x", &one) != 1) return 2;
            bytes[i] = (uint8_t)one;
        }
        hapticd_state state;
        uint64_t t_ns = 0;
        bool is_state = read_state(&state, bytes, length);
        if (is_state) drop_lifted(&plate, &state);
        read_reply(&plate, bytes, length, 1, &t_ns);
        messages++;
        states += is_state;
        free(bytes);
    }
    printf("%lu %lu\n", messages, states);
    return 0;
}
