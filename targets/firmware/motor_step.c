/* The steps of targets/motor-loop, operation by operation: src/references.rs, src/currents.rs and src/circle.rs say why each is as it is. */
#include "motor_step.h"

#include "circle.h"
#include "motor.h"

/* 1.5 * 2^23: what is added to it is rounded to a whole number. */
#define WHOLE 12582912.0f
/* sqrt(0.9), rounded down. */
#define LONGEST_LEG 0.9486832f
#define ROOT_3 1.7320508f
#define HALF_ROOT_3 0.8660254f
#define PER_ROOT_3 0.57735026f
#define TWO_THIRDS 0.6666667f

EXACT_INLINE float cosine(float turns)
{
    float whole = (turns + WHOLE) - WHOLE;
    return circle_sine_f32(1.0f - exact_product(4.0f, exact_magnitude(turns - whole)));
}

void motor_reference_init(motor_reference_state *state)
{
    static const motor_reference_state at_rest = {{0.0f, 0.0f, 0.0f, 0.0f}, {0u, 0u}};
    *state = at_rest;
}

void motor_current_init(motor_current_state *state)
{
    static const motor_current_state at_rest = {0.0f, 0.0f, {0.5f, 0.5f, 0.5f}, {0u, 0u}};
    *state = at_rest;
}

void motor_references(motor_reference_state *state, const motor_drive *drive, const motor_demand *demand)
{
    const float torque = demand->torque_nm, speed = demand->speed_rad_s, bus = demand->bus_voltage_v;
    const float circle_speed = exact_product(exact_magnitude(speed), drive->nominal_bus_v / bus);
    const float mirror = exact_select(speed, 0.0f, -1.0f, 1.0f);
    const float forwards = exact_product(mirror, torque);
    const float limit = drive->current_limit_a;
    const float most_weakening = exact_product(LONGEST_LEG, limit);
    const float last_nm = exact_product(drive->newton_metres_per_ampere, exact_product(mirror, state->last.i_q_a));
    const float at_limit_a = exact_within(motor_limit_current_f32(last_nm, limit, circle_speed), 0.0f, most_weakening);
    const float at_limit = exact_product(at_limit_a, drive->per_ampere);
    const float most = exact_product(limit, circle_height_f32(exact_product(at_limit, at_limit)));
    const float wanted = exact_within(exact_product(forwards, drive->amperes_per_newton_metre), -most, most);
    const float weakening = motor_weakening_current_f32(exact_product(drive->newton_metres_per_ampere, wanted), circle_speed);
    const float i_d = -exact_within(weakening, 0.0f, most_weakening);
    const float share = exact_product(i_d, drive->per_ampere);
    const float most_q = exact_product(limit, circle_height_f32(exact_product(share, share)));
    const float i_q = exact_product(mirror, exact_within(wanted, -most_q, most_q));
    const float resistive_d = exact_product(drive->resistance_ohm, i_d);
    const float resistive_q = exact_product(drive->resistance_ohm, i_q);

    float sum = exact_nothing(torque) + exact_nothing(speed) + exact_nothing(bus) + exact_nothing(circle_speed);
    sum = sum + exact_nothing(resistive_d) + exact_nothing(resistive_q) + exact_nothing(most) + exact_nothing(most_q);
    state->last.i_d_a = exact_select(sum, bus, i_d, state->last.i_d_a);
    state->last.i_q_a = exact_select(sum, bus, i_q, state->last.i_q_a);
    state->last.resistive_d_v = exact_select(sum, bus, resistive_d, state->last.resistive_d_v);
    state->last.resistive_q_v = exact_select(sum, bus, resistive_q, state->last.resistive_q_v);
    bad_samples_count(&state->bad, exact_less(sum, bus));
}

EXACT_INLINE float duty(const motor_drive *drive, float v, float centre, float per_bus, float current)
{
    const float lost = exact_product(drive->dead_time_share, exact_within(exact_product(current, drive->per_dead_time_ampere), -1.0f, 1.0f));
    return exact_within((exact_product(v - centre, per_bus) + 0.5f) + lost, 0.0f, 1.0f);
}

void motor_currents(motor_current_state *state, const motor_drive *drive, const motor_reference *reference, const motor_measured *measured)
{
    const float a = measured->currents_a[0], b = measured->currents_a[1], c = measured->currents_a[2];
    const float turns = measured->angle_turns, speed = measured->speed_rad_s, bus = measured->bus_voltage_v;
    const float alpha = exact_product(a - exact_product(0.5f, b + c), TWO_THIRDS);
    const float beta = exact_product(b - c, PER_ROOT_3);
    const float cos_now = cosine(turns), sin_now = cosine(turns - 0.25f);
    const float i_d = exact_product(cos_now, alpha) + exact_product(sin_now, beta);
    const float i_q = exact_product(cos_now, beta) - exact_product(sin_now, alpha);

    const float per_bus = 1.0f / bus;
    const float radius = exact_product(bus, PER_ROOT_3);
    const float w_e = exact_product(drive->pole_pairs, speed);
    const float error_d = reference->i_d_a - i_d;
    const float error_q = reference->i_q_a - i_q;
    const float rotation_d = -exact_product(w_e, exact_product(drive->inductance_h, reference->i_q_a));
    const float rotation_q = exact_product(w_e, exact_product(drive->inductance_h, reference->i_d_a) + drive->flux_linkage_wb);
    const float wanted_d = (exact_product(drive->gain_v_per_a, error_d) + state->integral_d_v) + (reference->resistive_d_v + rotation_d);
    const float wanted_q = (exact_product(drive->gain_v_per_a, error_q) + state->integral_q_v) + (reference->resistive_q_v + rotation_q);

    const float most_d = exact_product(LONGEST_LEG, radius);
    const float v_d = exact_within(wanted_d, -most_d, most_d);
    const float share = exact_product(exact_product(v_d, per_bus), ROOT_3);
    const float most_q = exact_product(radius, circle_height_f32(exact_product(share, share)));
    const float v_q = exact_within(wanted_q, -most_q, most_q);
    const float integral_d = state->integral_d_v
        + (exact_product(drive->integral_gain_v_per_a, error_d) + exact_product(drive->tracking, v_d - wanted_d));
    const float integral_q = state->integral_q_v
        + (exact_product(drive->integral_gain_v_per_a, error_q) + exact_product(drive->tracking, v_q - wanted_q));

    const float later = turns + exact_product(drive->advance_turns_s, speed);
    const float cos_then = cosine(later), sin_then = cosine(later - 0.25f);
    const float v_alpha = exact_product(cos_then, v_d) - exact_product(sin_then, v_q);
    const float v_beta = exact_product(sin_then, v_d) + exact_product(cos_then, v_q);
    const float half = exact_product(0.5f, v_alpha);
    const float side = exact_product(HALF_ROOT_3, v_beta);
    const float v_a = v_alpha;
    const float v_b = side - half;
    const float v_c = -side - half;
    const float highest = exact_at_least(exact_at_least(v_a, v_b), v_c);
    const float lowest = exact_at_most(exact_at_most(v_a, v_b), v_c);
    const float centre = exact_product(0.5f, highest + lowest);
    const float duty_a = duty(drive, v_a, centre, per_bus, a);
    const float duty_b = duty(drive, v_b, centre, per_bus, b);
    const float duty_c = duty(drive, v_c, centre, per_bus, c);

    float sum = exact_nothing(a) + exact_nothing(b) + exact_nothing(c) + exact_nothing(turns) + exact_nothing(speed);
    sum = sum + exact_nothing(bus) + exact_nothing(per_bus) + exact_nothing(integral_d) + exact_nothing(integral_q);
    sum = sum + exact_nothing(duty_a) + exact_nothing(duty_b) + exact_nothing(duty_c);
    state->integral_d_v = exact_select(sum, bus, integral_d, state->integral_d_v);
    state->integral_q_v = exact_select(sum, bus, integral_q, state->integral_q_v);
    state->last[0] = exact_select(sum, bus, duty_a, state->last[0]);
    state->last[1] = exact_select(sum, bus, duty_b, state->last[1]);
    state->last[2] = exact_select(sum, bus, duty_c, state->last[2]);
    bad_samples_count(&state->bad, exact_less(sum, bus));
}
