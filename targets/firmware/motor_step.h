/* The two steps of a permanent-magnet AC motor in flux weakening: the twin of targets/motor-loop in C, bit for bit.
 *
 * In: motor_references, at 1 kHz: torque demand, speed, bus voltage. motor_currents, once a PWM period: references and samples. Out: current
 * references; duties of three legs, and whether the bridge is closed. Every function, struct and name is explained in targets/motor-loop/src. Never loops, branches or allocates.
 */
#ifndef MOTOR_STEP_H
#define MOTOR_STEP_H

#include "exact.h"

typedef struct {
    float middle;
    float half;
    float rate;
} motor_band;

typedef struct {
    motor_band bus_v;
    float speed_rad_s;
    float speed_rate_rad_s;
    float torque_nm;
    float angle_turns;
    float angle_rate_turns;
    float current_sum_a;
    float current_square_a2;
    float current_rate_square_a2;
    float trip_square_a2;
    uint32_t bad_in_a_row;
    float good_in_a_row;
} motor_limits;

typedef struct {
    float newton_metres_per_ampere;
    float amperes_per_newton_metre;
    float current_limit_a;
    float per_ampere;
    float limit_current_once_a;
    float most_weakening_a;
    float nominal_bus_v;
    float weakening_per_speed;
    float resistance_ohm;
    float inductance_h;
    float flux_linkage_wb;
    float pole_pairs;
    float turned_per_speed;
    float turns_per_speed;
    float amperes_per_volt;
    float characteristic_current_a;
    float gain_v_per_a;
    float integral_share;
    float slew_a;
    float slew_v_per_a;
    float advance_turns_s;
    float dead_time_share;
    float per_dead_time_ampere;
    motor_limits limits;
} motor_drive;

typedef struct {
    float torque_nm;
    float speed_rad_s;
    float bus_voltage_v;
    float voltage_share;
} motor_demand;

typedef struct {
    float i_d_a;
    float i_q_a;
} motor_reference;

typedef struct {
    motor_reference last;
    float torque_nm;
    float speed_rad_s;
    float bus_voltage_v;
    float trim_a;
    bad_samples bad;
} motor_reference_state;

typedef struct {
    float currents_a[3];
    float angle_turns;
    float speed_rad_s;
    float bus_voltage_v;
} motor_measured;

typedef struct {
    float duties[3];
    /* 1; or 0, the safe state: all six switches are to be off, whatever the duties say. */
    float closed;
} motor_command;

typedef struct {
    float integral_d_v;
    float integral_q_v;
    float reference_d_a;
    float reference_q_a;
    float v_d_v;
    float v_q_v;
    float expected_d_a;
    float expected_q_a;
    float angle_turns;
    float speed_rad_s;
    float bus_voltage_v;
    float waiting;
    float voltage_share;
    motor_command last;
    bad_samples bad;
} motor_current_state;

void motor_reference_init(motor_reference_state *state);
void motor_current_init(motor_current_state *state);

/* state->last becomes this tick's references. */
void motor_references(motor_reference_state *state, const motor_drive *drive, const motor_demand *demand);

/* state->last becomes what the bridge does in the next period. */
void motor_currents(motor_current_state *state, const motor_drive *drive, const motor_reference *reference, const motor_measured *measured);

#endif
