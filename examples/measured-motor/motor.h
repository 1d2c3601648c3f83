/* The numbers of the motor and its inverter: change them for your own. */
#ifndef MOTOR_H
#define MOTOR_H

/* Baldor ECS101M0H7EF4, 5.6 kW, 460 V, 8.8 A, 60 Hz, 29.7 N m. */
#define POLE_PAIRS 2
/* Amplitude of the current, in A: 1.5 times the rated one. It must lie inside the flux map. */
#ifndef CURRENT_LIMIT
#define CURRENT_LIMIT 18.67
#endif
/* Flux linkage times electrical speed, in V: 0.95 of the bus voltage of 650 V over the root of 3. The rest is for the resistance and for control. */
#define VOLTAGE 356.5
/* What a surface and a table may be asked for: torque in N m, speed in mechanical rad/s. */
#define TOP_TORQUE 52.0
#define TOP_SPEED 500.0

/* The controllers compute in float. The reference that judges them is the same source in double. */
#if defined(OPTIMUM_DOUBLE)
typedef double real;
#else
typedef float real;
#endif

typedef struct {
    real i_d;
    real i_q;
} current;

#endif
