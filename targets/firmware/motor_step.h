/* The two steps of a permanent-magnet AC motor in flux weakening: the twin of targets/motor-loop in C, bit for bit.
 *
 * In: motor_references, at 1 kHz: torque demand, speed, bus voltage. motor_currents, once a PWM period: references and samples. Out: current
 * references; duties of three legs. Every function, struct and name is explained in targets/motor-loop/src. Never loops, branches or allocates.
 */
#ifndef MOTOR_STEP_H
#define MOTOR_STEP_H

#include "exact.h"

typedef struct {
    float newton_metres_per_ampere;
    float amperes_per_newton_metre;
    float current_limit_a;
    float per_ampere;
    float nominal_bus_v;
    float resistance_ohm;
    float inductance_h;
    float flux_linkage_wb;
    float pole_pairs;
    float gain_v_per_a;
    float integral_gain_v_per_a;
    float tracking;
    float advance_turns_s;
    float dead_time_share;
    float per_dead_time_ampere;
} motor_drive;

typedef struct {
    float torque_nm;
    float speed_rad_s;
    float bus_voltage_v;
} motor_demand;

typedef struct {
    float i_d_a;
    float i_q_a;
    float resistive_d_v;
    float resistive_q_v;
} motor_reference;

typedef struct {
    motor_reference last;
    bad_samples bad;
} motor_reference_state;

typedef struct {
    float currents_a[3];
    float angle_turns;
    float speed_rad_s;
    float bus_voltage_v;
} motor_measured;

typedef struct {
    float integral_d_v;
    float integral_q_v;
    /* The duties: of this period's step, or held. */
    float last[3];
    bad_samples bad;
} motor_current_state;

void motor_reference_init(motor_reference_state *state);
void motor_current_init(motor_current_state *state);

/* state->last becomes this tick's references. */
void motor_references(motor_reference_state *state, const motor_drive *drive, const motor_demand *demand);

/* state->last becomes the duties of the next period. */
void motor_currents(motor_current_state *state, const motor_drive *drive, const motor_reference *reference, const motor_measured *measured);

#endif
