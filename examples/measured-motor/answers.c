/* Prints the answers of the full controller as CSV, a row a point of torque and speed: what the surfaces are fitted to. Compiled with -DOPTIMUM_DOUBLE.
 *
 * Besides the currents a row has the largest torque at its speed (`limit_torque`, a line below the speed at which the voltage begins to limit it), the speed up to which its torque needs no weakening (`base_speed`), and by how
 * much its speed is above that (`beyond`). A weight says how much an ampere counts: the angle of a small current moves more than that of a large one.
 */
#include <math.h>
#include <stdio.h>

#include "optimum.h"

#define TORQUES 48
#define SPEEDS 42

int main(void)
{
    int j, k;
    const double corner = VOLTAGE / (POLE_PAIRS * optimum_flux(optimum_currents(TOP_TORQUE, 0.0).i));
    puts("torque[N*m],speed[rad/s],limit_speed[rad/s],limit_torque[N*m],base_speed[rad/s],beyond[rad/s],i_d[A],i_q[A],weight");
    for (j = 0; j < SPEEDS; j++) {
        /* Most speeds are where the voltage limits. */
        const double share = (j + 0.5) / SPEEDS;
        const double speed = TOP_SPEED * (share < 0.1 ? 2.0 * share : 0.2 + (share - 0.1) * 8.0 / 9.0);
        const double limit = optimum_torque(optimum_currents(TOP_TORQUE, speed).i);
        for (k = 0; k < TORQUES; k++) {
            /* Small torques are closer together: there the angle turns fastest. */
            const double part = (k + 1.0) / TORQUES;
            const double torque = limit * part * (0.3 + 0.7 * part);
            const optimum o = optimum_currents(torque, speed);
            const double base = VOLTAGE / (POLE_PAIRS * optimum_flux(optimum_currents(torque, 0.0).i));
            const double beyond = speed > base ? speed - base : 0.0;
            const double weight = 1.0 / (o.i.i_d * o.i.i_d + o.i.i_q * o.i.i_q + 4.0);
            printf("%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g\n", torque, speed, speed > corner ? speed : corner, limit, base, beyond, o.i.i_d, o.i.i_q, weight);
        }
    }
    return 0;
}
