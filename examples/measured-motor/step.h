/* The surfaces as a controller, and the table that it is compared with. */
#ifndef STEP_H
#define STEP_H

#include "motor.h"

/* Currents for a torque in N m at a speed in mechanical rad/s, by surfaces. No branch. */
current step_currents(float torque, float speed);

/* The same by bilinear interpolation. */
current table_currents(float torque, float speed);

#endif
