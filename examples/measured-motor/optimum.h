/* The full controller: the currents of least amplitude that give a torque, within the limits of current and voltage. See optimum.c. */
#ifndef OPTIMUM_H
#define OPTIMUM_H

#include "motor.h"

/* What rules at the optimum. */
typedef enum {
    LEAST_CURRENT,   /* maximum torque per ampere */
    WEAKENING,       /* the voltage limit, with the torque that was asked for */
    CURRENT_LIMITED, /* the current limit, with or without the voltage limit: less torque than was asked for */
    VOLTAGE_LIMITED  /* maximum torque per volt: less torque than was asked for */
} regime;

typedef struct {
    current i;
    regime rule;
    /* Evaluations of the flux map: what the solution cost. */
    int evaluations;
} optimum;

/* torque in N m, speed in mechanical rad/s. Speed and torque may have either sign. */
optimum optimum_currents(real torque, real speed);

/* Torque of the map, in N m, and its flux linkage, in V s. */
real optimum_torque(current i);
real optimum_flux(current i);

#endif
