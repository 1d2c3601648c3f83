/* Prints operating points that no fit and no table has seen, with the answers of the full controller: lines "TORQUE SPEED I_D I_Q". Compiled with -DOPTIMUM_DOUBLE.
 *
 * Torques of either sign from 1 N m on, also beyond what the limits leave, and all speeds. The points are drawn evenly, by a linear congruential generator (Knuth's MMIX).
 */
#include <stdint.h>
#include <stdio.h>

#include "optimum.h"

#define POINTS 10000

static double drawn(void)
{
    static uint64_t state = 27;
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(state >> 11) / 9007199254740992.0;
}

int main(void)
{
    int k;
    for (k = 0; k < POINTS; k++) {
        const double magnitude = 1.0 + (TOP_TORQUE - 1.0) * drawn();
        const double speed = TOP_SPEED * drawn();
        const double torque = k % 2 == 0 ? magnitude : -magnitude;
        const optimum o = optimum_currents(torque, speed);
        printf("%.9g %.9g %.9g %.9g\n", torque, speed, o.i.i_d, o.i.i_q);
    }
    return 0;
}
