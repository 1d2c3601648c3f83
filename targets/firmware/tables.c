#include "tables.h"

const motor_drive tables_drive = {
    .newton_metres_per_ampere = 0.35999998f,
    .amperes_per_newton_metre = 2.777778f,
    .current_limit_a = 60.0f,
    .per_ampere = 0.016666668f,
    .nominal_bus_v = 270.0f,
    .resistance_ohm = 0.08f,
    .inductance_h = 0.0009f,
    .flux_linkage_wb = 0.06f,
    .pole_pairs = 4.0f,
    .gain_v_per_a = 1.35f,
    .integral_gain_v_per_a = 0.012f,
    .tracking = 0.008888889f,
    .advance_turns_s = 9.549296e-5f,
    .dead_time_share = 0.01f,
    .per_dead_time_ampere = 1.0f,
};

const throttle_scaling tables_scaling = {
    /* zero in counts, value of a count, lowest and highest counts of a whole wire */
    .pedal = {409.5f, 0.00030525032f, 205.0f, 3890.0f},
    .plate = {409.5f, 0.00030525032f, 205.0f, 3890.0f},
    .speed = {0.0f, 0.014652015f, 0.0f, 4054.0f},
    .compare_closed = 180.0f,
    .compare_span = 3240.0f,
};
