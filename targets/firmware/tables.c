#include "tables.h"

const motor_drive tables_drive = {
    .newton_metres_per_ampere = 0.35999998f,
    .amperes_per_newton_metre = 2.777778f,
    .current_limit_a = 60.0f,
    .per_ampere = 0.016666668f,
    .limit_current_once_a = 27.436113f,
    .most_weakening_a = 56.920994f,
    .nominal_bus_v = 270.0f,
    .weakening_per_speed = 0.08451719f,
    .resistance_ohm = 0.08f,
    .inductance_h = 0.0009f,
    .flux_linkage_wb = 0.06f,
    .pole_pairs = 4.0f,
    .turned_per_speed = 0.0004f,
    .turns_per_speed = 6.366197e-5f,
    .amperes_per_volt = 0.11111111f,
    .characteristic_current_a = 66.666664f,
    .gain_v_per_a = 1.35f,
    .integral_share = 0.008888889f,
    .slew_a = 3.0f,
    .slew_v_per_a = 6.7500005f,
    .advance_turns_s = 9.549296e-5f,
    .dead_time_share = 0.01f,
    .per_dead_time_ampere = 1.0f,
    .limits.torque_nm = 43.199997f,
    .limits.angle_turns = 4.0f,
    .limits.angle_rate_turns = 0.04f,
    .limits.current_sum_a = 12.0f,
    .limits.current_square_a2 = 14400.0f,
    .limits.current_rate_square_a2 = 225.0f,
    .limits.trip_square_a2 = 4121.6396f,
    .limits.speed_rad_s = 1000.0f,
    .limits.speed_rate_rad_s = 100.0f,
    .limits.good_in_a_row = 10.0f,
    .limits.bad_in_a_row = 10u,
    /* middle and half of the range, and the most from what is expected */
    .limits.bus_v = {255.0f, 105.0f, 50.0f},
};

const throttle_scaling tables_scaling = {
    /* zero in counts, value of a count, lowest and highest counts of a whole wire */
    .pedal = {409.5f, 0.00030525032f, 205.0f, 3890.0f},
    .plate = {409.5f, 0.00030525032f, 205.0f, 3890.0f},
    .speed = {0.0f, 0.014652015f, 0.0f, 4054.0f},
    .compare_closed = 180.0f,
    .compare_span = 3240.0f,
};
