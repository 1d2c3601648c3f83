/* The constrained optimum over a measured flux map, by Newton's method, from a cold start.
 *
 * In: torque and speed. Out: the currents of least amplitude with this torque, inside the circle of the current limit and inside the flux that the voltage
 * leaves at this speed; where no current is inside both, those of the most torque. It tries the regimes in turn, each a system of two equations:
 *
 *   maximum torque per ampere    torque = asked,   i x grad(torque) = 0
 *   flux weakening               torque = asked,   flux = the limit
 *   current limit                |i| = the limit,  i x grad(torque) = 0, or where that has too much flux: flux = the limit
 *   maximum torque per volt      flux = the limit, grad(flux) x grad(torque) = 0
 *
 * The flux map is a pair of smooth surfaces with their gradients. The rows of torque, flux and current have exact derivatives. The other rows would need second
 * derivatives of the map; Broyden's formula supplies them. An iteration costs one evaluation of the map.
 */
#include "optimum.h"

#include <math.h>

#include "flux_map.h"

#define LIMIT ((real)CURRENT_LIMIT)
#define MOST_EVALUATIONS 60
/* No iteration moves a current farther: the map is no straight line. In A. */
#define LONGEST_STEP ((real)5.0)
/* A solution is found when its last step is below this, in A: 0.003 degrees at 18.67 A. */
#define CLOSE_ENOUGH ((real)1e-3)
/* Torque below which the currents are those of this torque: the angle of no current is not defined. In N m. */
#define LEAST_TORQUE ((real)0.05)

/* The map at a point: torque and squared flux with their derivatives by i_d and i_q. */
typedef struct {
    real torque, torque_d, torque_q;
    real square, square_d, square_q;
} point;

static point at(current i)
{
    const real k = (real)(1.5 * POLE_PAIRS);
    real d[2], q[2], psi_d, psi_q;
    point p;
#if defined(OPTIMUM_DOUBLE)
    psi_d = flux_map_psi_d(i.i_d, i.i_q);
    psi_q = flux_map_psi_q(i.i_d, i.i_q);
    flux_map_psi_d_gradient(i.i_d, i.i_q, d);
    flux_map_psi_q_gradient(i.i_d, i.i_q, q);
#else
    psi_d = flux_map_psi_d_f32(i.i_d, i.i_q);
    psi_q = flux_map_psi_q_f32(i.i_d, i.i_q);
    flux_map_psi_d_gradient_f32(i.i_d, i.i_q, d);
    flux_map_psi_q_gradient_f32(i.i_d, i.i_q, q);
#endif
    p.torque = k * (psi_d * i.i_q - psi_q * i.i_d);
    p.torque_d = k * (d[0] * i.i_q - psi_q - q[0] * i.i_d);
    p.torque_q = k * (psi_d + d[1] * i.i_q - q[1] * i.i_d);
    p.square = psi_d * psi_d + psi_q * psi_q;
    p.square_d = (real)2.0 * (psi_d * d[0] + psi_q * q[0]);
    p.square_q = (real)2.0 * (psi_d * d[1] + psi_q * q[1]);
    return p;
}

real optimum_torque(current i)
{
    return at(i).torque;
}

real optimum_flux(current i)
{
    return (real)sqrt((double)at(i).square);
}

/* A row of a system: its value and its derivatives. */
typedef struct {
    real value, by_d, by_q;
} row;

typedef enum { TORQUE, FLUX, AMPLITUDE, PER_AMPERE, PER_VOLT } equation;

/* The row of an equation. Those of the two maxima have no exact derivatives: what is given is a first guess. */
static row row_of(equation which, current i, const point *p, real torque, real square)
{
    row r;
    switch (which) {
    case TORQUE:
        r.value = p->torque - torque;
        r.by_d = p->torque_d;
        r.by_q = p->torque_q;
        break;
    case FLUX:
        r.value = p->square - square;
        r.by_d = p->square_d;
        r.by_q = p->square_q;
        break;
    case AMPLITUDE:
        r.value = i.i_d * i.i_d + i.i_q * i.i_q - LIMIT * LIMIT;
        r.by_d = (real)2.0 * i.i_d;
        r.by_q = (real)2.0 * i.i_q;
        break;
    case PER_AMPERE:
        /* With constant inductances torque_d is proportional to i_q and torque_q a line in i_d: then these derivatives are exact. */
        r.value = i.i_d * p->torque_q - i.i_q * p->torque_d;
        r.by_d = p->torque_q + i.i_d * p->torque_d / i.i_q;
        r.by_q = (real)-2.0 * p->torque_d;
        break;
    default:
        /* With constant inductances, too, where the flux of the magnets is left out. */
        r.value = p->square_d * p->torque_q - p->square_q * p->torque_d;
        r.by_d = p->square_d * p->torque_d / i.i_q;
        r.by_q = -p->torque_d * p->square_q / i.i_q;
        break;
    }
    return r;
}

/* Solves two equations from a start. 1 where it ends close enough. The second one may be a maximum, whose derivatives Broyden's formula keeps. */
static int solve(equation first, equation second, real torque, real square, optimum *o, point *p)
{
    const int kept = second == PER_AMPERE || second == PER_VOLT;
    row b = row_of(second, o->i, p, torque, square);
    while (o->evaluations < MOST_EVALUATIONS) {
        const row a = row_of(first, o->i, p, torque, square);
        const real determinant = a.by_d * b.by_q - a.by_q * b.by_d;
        real step_d = (b.value * a.by_q - a.value * b.by_q) / determinant;
        real step_q = (a.value * b.by_d - b.value * a.by_d) / determinant;
        const real length = (real)sqrtf((float)(step_d * step_d + step_q * step_q));
        row next;
        if (!(length < (real)1e6)) {
            return 0;
        }
        if (length > LONGEST_STEP) {
            step_d *= LONGEST_STEP / length;
            step_q *= LONGEST_STEP / length;
        }
        o->i.i_d += step_d;
        o->i.i_q += step_q;
        /* Torque is asked for with its sign taken off, and nothing is gained with a current that strengthens the magnets. */
        if (o->i.i_q < (real)1e-3) {
            o->i.i_q = (real)1e-3;
        }
        if (o->i.i_d > (real)0.0) {
            o->i.i_d = (real)0.0;
        }
        *p = at(o->i);
        o->evaluations++;
        if (length < CLOSE_ENOUGH) {
            return 1;
        }
        next = row_of(second, o->i, p, torque, square);
        if (kept) {
            const real missed = (next.value - b.value - b.by_d * step_d - b.by_q * step_q) / (step_d * step_d + step_q * step_q);
            next.by_d = b.by_d + missed * step_d;
            next.by_q = b.by_q + missed * step_q;
        }
        b = next;
    }
    return 0;
}

static int inside(current i)
{
    return i.i_d * i.i_d + i.i_q * i.i_q <= LIMIT * LIMIT;
}

/* Whether more flux would give more torque at the same flux limit: this side of maximum torque per volt. */
static int before_torque_per_volt(const point *p)
{
    return p->square_q * p->torque_d - p->square_d * p->torque_q <= (real)0.0;
}

optimum optimum_currents(real torque, real speed)
{
    const real asked = torque < (real)0.0 ? -torque : torque;
    const real wanted = asked < LEAST_TORQUE ? LEAST_TORQUE : asked;
    const real electrical = (real)POLE_PAIRS * (speed < (real)0.0 ? -speed : speed);
    const real limit = electrical > (real)1.0 ? (real)VOLTAGE / electrical : (real)VOLTAGE;
    const real square = limit * limit;
    optimum o;
    point p;
    int found;

    /* A guess from rated values: an ampere gives about 2 N m, with as much of it on the d axis as on the q axis at full torque. */
    o.i.i_q = (real)0.7 * (real)sqrtf((float)wanted);
    o.i.i_d = (real)-0.25 * wanted;
    if (o.i.i_d < -o.i.i_q) {
        o.i.i_d = -o.i.i_q;
    }
    o.evaluations = 1;
    o.rule = LEAST_CURRENT;
    p = at(o.i);
    found = solve(TORQUE, PER_AMPERE, wanted, square, &o, &p);
    if (!found || !inside(o.i)) {
        /* More torque than the current limit gives. */
        o.rule = CURRENT_LIMITED;
        (void)solve(AMPLITUDE, PER_AMPERE, wanted, square, &o, &p);
    }
    if (p.square > square) {
        if (o.rule == LEAST_CURRENT) {
            o.rule = WEAKENING;
            found = solve(TORQUE, FLUX, wanted, square, &o, &p);
        } else {
            found = 0;
        }
        if (!found || !inside(o.i) || !before_torque_per_volt(&p)) {
            o.rule = CURRENT_LIMITED;
            found = solve(AMPLITUDE, FLUX, wanted, square, &o, &p);
            if (!found || !before_torque_per_volt(&p)) {
                o.rule = VOLTAGE_LIMITED;
                (void)solve(FLUX, PER_VOLT, wanted, square, &o, &p);
            }
        }
    }
    if (torque < (real)0.0) {
        o.i.i_q = -o.i.i_q;
    }
    return o;
}
