/* What the modes do to each other where a finger couples them.
 *
 * Beyond its own change of damping and detuning (observer.h) a mode's disturbance is d = sum over q of C_q W_q. Least squares
 * with one step size for all directions learn a row C at each tick, in turn: exact for amplitudes that grow in one direction,
 * as in a step, and never further from the truth than before. With it, the disturbance is known for the next amplitudes.
 * All rows at each tick would cost more than a tick has.
 */
#ifndef HD_COUPLING_H
#define HD_COUPLING_H

#include "control.h"

/* After the observers' corrections: learns, and brings the disturbances to the next amplitudes. */
void hd_couple(hd_control_t *control);

#endif
