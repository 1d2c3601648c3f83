/* Errors of the controllers in float against the full controller in double, on operating points that no fit has seen. For the host.
 *
 * Reads lines "TORQUE SPEED I_D I_Q ROW" of the reference on standard input (reference.c wrote them), prints a line a controller:
 * NAME, then mean, 99th percentile and largest of the error of the angle in degrees, the same of the torque in N m, then the largest share of the voltage limit and
 * of the current limit that it takes.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "optimum.h"
#include "step.h"

#define MOST 20000

static double torque[MOST], speed[MOST], i_d[MOST], i_q[MOST];
static int count;

static current full(float asked, float at)
{
    return optimum_currents(asked, at).i;
}

static int order(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void print_of(const double *errors)
{
    static double sorted[MOST];
    double sum = 0.0;
    int k;
    for (k = 0; k < count; k++) {
        sorted[k] = errors[k];
        sum += errors[k];
    }
    qsort(sorted, (size_t)count, sizeof sorted[0], order);
    printf(" %.3f %.3f %.3f", sum / count, sorted[(count * 99) / 100], sorted[count - 1]);
}

static void judge(const char *name, current (*controller)(float, float))
{
    static double angle[MOST], missed[MOST];
    const double degree = 57.29577951308232;
    double voltage = 0.0, amplitude = 0.0;
    int k;
    for (k = 0; k < count; k++) {
        const current i = controller((float)torque[k], (float)speed[k]);
        const double share = (double)optimum_flux(i) * POLE_PAIRS * speed[k] / VOLTAGE;
        current reference;
        double turned = fabs(atan2((double)i.i_q, (double)i.i_d) - atan2(i_q[k], i_d[k])) * degree;
        if (turned > 180.0) {
            turned = 360.0 - turned;
        }
        reference.i_d = (real)i_d[k];
        reference.i_q = (real)i_q[k];
        angle[k] = turned;
        missed[k] = fabs((double)optimum_torque(i) - (double)optimum_torque(reference));
        voltage = share > voltage ? share : voltage;
        amplitude = fmax(amplitude, sqrt((double)i.i_d * (double)i.i_d + (double)i.i_q * (double)i.i_q) / CURRENT_LIMIT);
    }
    printf("%s", name);
    print_of(angle);
    print_of(missed);
    printf(" %.3f %.3f\n", voltage, amplitude);
}

int main(void)
{
    while (count < MOST && scanf("%lf %lf %lf %lf", &torque[count], &speed[count], &i_d[count], &i_q[count]) == 4) {
        count++;
    }
    if (count == 0) {
        return 1;
    }
    judge("solver", full);
    judge("table", table_currents);
    judge("surface", step_currents);
    return 0;
}
