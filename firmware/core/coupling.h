/* What the modes do to each other where a finger couples them.
 *
 * Beyond its own change of damping and detuning (observer.h) a mode's disturbance is d = sum over q of C_q W_q. Least squares
 * with one step size for all directions learn the rows C at each tick: exact for amplitudes that grow in one direction, as in
 * a step, and never further from the truth than before. With them, the disturbance is known for the next amplitudes.
 */
#ifndef HD_COUPLING_H
#define HD_COUPLING_H

#include "control.h"

#define HD_COUPLING_MEMORY_S 0.02f /* as of the damping and detuning (observer.c) */

/* After the observers' corrections: learns, and brings the disturbances to the next amplitudes. */
void hd_couple(hd_control_t *control);

#endif
