/* The steps of targets/motor-loop: src/references.rs, src/currents.rs, src/plausible.rs and src/circle.rs say why each is as it is.
 *
 * The bits are those of the Rust steps. Where several selections there ask the same, one comparison does it here: flags of good samples are counts of bad ones,
 * signs are bits, and a bound that a value cannot reach a second time is left out.
 */
#include "motor_step.h"

/* The evaluators as source: see EXACT_FLATTEN. */
#include "circle.c"
#include "motor.c"

/* 1.5 * 2^23: what is added to it is rounded to a whole number. */
#define WHOLE 12582912.0f
/* Of circle.rs: the square of the circle's radius, a little held back. */
#define HELD_BACK 0.9996f
#define ROOT_3 1.7320508f
#define HALF_ROOT_3 0.8660254f
#define PER_ROOT_3 0.57735026f
#define TWO_THIRDS 0.6666667f

/* Of references.rs. */
#define SLOWEST 440.0f
#define FOLD_SPEED 780.0f
#define FOLD_PER (1.0f / 780.0f)
#define TRIM_FROM 0.96f
#define TRIM_MOST 1.2f
#define TRIM_A 5.5f

/* Of currents.rs and plausible.rs. */
#define BELIEVED 0.15f
#define BELIEVED_LEVEL 0.25f
#define INTEGRAL_SHARE 0.2f
#define PERIODS_TO_CLOSE 1.0f
#define FIRST_WAIT 11.0f

EXACT_INLINE float part_of_turn(float turns)
{
    return turns - ((turns + WHOLE) - WHOLE);
}

EXACT_INLINE float cosine(float turns)
{
    return circle_sine_f32(1.0f - exact_product(4.0f, exact_magnitude(part_of_turn(turns))));
}

EXACT_INLINE float other_leg(float square)
{
    return exact_root(HELD_BACK - square);
}

/* How much of a sample is believed whose rate is good, and of one whose rate is bad; and what the second counts for. */
typedef struct {
    float good;
    float bad;
    uint32_t counts;
} belief;

/* judge of plausible.rs by one comparison each for range and rate: of what is out of range nothing is left, and any share of it is nothing. */
EXACT_INLINE float followed(float rate, float from_middle, float half, float off, float expected, const belief *how, uint32_t *bad)
{
    float share = how->good;
    exact_unless(exact_magnitude(off), rate, &share, how->bad, bad, how->counts);
    exact_unless(exact_magnitude(from_middle), half, &off, 0.0f, bad, 1u);
    return expected + exact_product(share, off);
}

EXACT_INLINE float followed_bus(const motor_limits *limits, float sample, float expected, const belief *how, uint32_t *bad)
{
    const motor_band *band = &limits->bus_v;
    return followed(band->rate, sample - band->middle, band->half, sample - expected, expected, how, bad);
}

EXACT_INLINE float followed_speed(const motor_limits *limits, float sample, float expected, const belief *how, uint32_t *bad)
{
    return followed(limits->speed_rate_rad_s, sample, limits->speed_rad_s, sample - expected, expected, how, bad);
}

void motor_reference_init(motor_reference_state *state)
{
    static const motor_reference_state at_rest = {{0.0f, 0.0f}, 0.0f, 0.0f, 0.0f, 0.0f, {0u, 0u}};
    *state = at_rest;
}

void motor_current_init(motor_current_state *state)
{
    static const motor_current_state at_rest = {
        0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, FIRST_WAIT, 0.0f, {{0.5f, 0.5f, 0.5f}, 0.0f}, {0u, 0u}};
    *state = at_rest;
}

EXACT_FLATTEN void motor_references(motor_reference_state *state, const motor_drive *drive, const motor_demand *demand)
{
    const motor_limits *limits = &drive->limits;
    const float limit = drive->current_limit_a;
    float torque = demand->torque_nm, share_seen = demand->voltage_share, coast = 0.0f, amperes_per_newton_metre = drive->amperes_per_newton_metre;
    belief how = {BELIEVED_LEVEL, 0.0f, 1u};
    uint32_t bad = 0u;
    exact_replace_two_from(state->bad.in_a_row, limits->bad_in_a_row, &coast, 1.0f, &amperes_per_newton_metre, 0.0f);
    /* Before the first good sample of the bus all that is in range is believed, and good. */
    how.bad = coast;
    exact_unless_two(0.0f, state->bus_voltage_v, &how.good, 1.0f, &how.bad, 1.0f, &how.counts, (uint32_t)-1);
    exact_unless_within(limits->torque_nm, &torque, state->torque_nm, &bad);
    exact_unless(share_seen, 1e6f, &share_seen, TRIM_FROM, &bad, 1u);
    share_seen = exact_at_most(share_seen, TRIM_MOST);
    const float speed = followed_speed(limits, demand->speed_rad_s, state->speed_rad_s, &how, &bad);
    const float bus = followed_bus(limits, demand->bus_voltage_v, state->bus_voltage_v, &how, &bad);

    const float lowest_bus = limits->bus_v.middle - limits->bus_v.half;
    const float circle_speed = exact_product(exact_magnitude(speed), drive->nominal_bus_v / exact_at_least(bus, lowest_bus));
    const float asked = exact_at_most(circle_speed, FOLD_SPEED);
    const float beyond = circle_speed - asked;
    const float inside = exact_at_least(asked, SLOWEST);
    const float fold = exact_at_least(1.0f - exact_product(beyond, FOLD_PER), 0.0f);
    const float moved = exact_at_least(state->trim_a + exact_product(TRIM_A, share_seen - TRIM_FROM), 0.0f);
    const float trim = exact_at_most(moved, limit);
    const float mirrored = exact_signed(drive->newton_metres_per_ampere, speed), way = exact_sign(torque);
    const float asked_a = exact_product(exact_magnitude(torque), amperes_per_newton_metre);
    const float last_nm = exact_product(mirrored, state->last.i_q_a);
    const float at_limit_a = exact_within(motor_limit_current_inside_f32(last_nm, inside, drive->limit_current_once_a), 0.0f, drive->most_weakening_a);
    const float at_limit = exact_product(at_limit_a, drive->per_ampere);
    const float most = exact_product(fold, exact_product(limit, other_leg(exact_product(at_limit, at_limit))));
    const float wanted = exact_at_most(asked_a, most);
    const float forwards_nm = exact_product(mirrored, exact_product(way, wanted));
    const float surface = exact_at_least(motor_weakening_current_inside_f32(forwards_nm, inside), 0.0f);
    const float weakening = surface + (exact_product(beyond, drive->weakening_per_speed) + trim);
    const float i_d = -exact_at_most(weakening, drive->most_weakening_a);
    const float share = exact_product(i_d, drive->per_ampere);
    const float most_q = exact_product(limit, other_leg(exact_product(share, share)));
    const float i_q = exact_product(way, exact_at_most(wanted, most_q));

    state->last.i_d_a = i_d;
    state->last.i_q_a = i_q;
    state->trim_a = trim;
    state->torque_nm = torque;
    state->speed_rad_s = speed;
    state->bus_voltage_v = bus;
    bad_samples_add(&state->bad, bad);
}

EXACT_INLINE float per_root(float square)
{
    const float half = exact_product(0.5f, square);
    uint32_t bits;
    float guess, once;
    __builtin_memcpy(&bits, &square, sizeof bits);
    bits = 0x5F3759DFu - (bits >> 1);
    __builtin_memcpy(&guess, &bits, sizeof guess);
    once = exact_product(guess, 1.5f - exact_product(half, exact_product(guess, guess)));
    return exact_product(once, 1.5f - exact_product(half, exact_product(once, once)));
}

EXACT_INLINE float move_d(const motor_drive *drive, const motor_current_state *state, float turned, float d, float q)
{
    return exact_product(drive->amperes_per_volt, state->v_d_v - exact_product(drive->resistance_ohm, d)) + exact_product(turned, q);
}

EXACT_INLINE float move_q(const motor_drive *drive, const motor_current_state *state, float turned, float d, float q)
{
    return exact_product(drive->amperes_per_volt, state->v_q_v - exact_product(drive->resistance_ohm, q))
        - exact_product(turned, d + drive->characteristic_current_a);
}

EXACT_INLINE float duty(const motor_drive *drive, float v, float centre, float per_bus, float current)
{
    const float lost = exact_product(drive->dead_time_share, exact_within(exact_product(current, drive->per_dead_time_ampere), -1.0f, 1.0f));
    const float on = exact_within((exact_product(v - centre, per_bus) + 0.5f) + lost, 0.0f, 1.0f);
    return exact_select(on, 2.0f, on, 0.5f);
}

EXACT_FLATTEN void motor_currents(motor_current_state *state, const motor_drive *drive, const motor_reference *reference, const motor_measured *measured)
{
    const motor_limits *limits = &drive->limits;
    const float a = measured->currents_a[0], b = measured->currents_a[1], c = measured->currents_a[2];
    const float turns = measured->angle_turns;
    const float open = exact_select(0.0f, state->waiting, 1.0f, 0.0f);
    belief how = {BELIEVED_LEVEL, open, 1u};
    float off = part_of_turn(turns - state->angle_turns), angle_share = BELIEVED, doubted_angle = open;
    uint32_t bad = 0u;
    float bus, speed, angle;
    exact_unless_three(0.0f, state->bus_voltage_v, &how.good, 1.0f, &how.bad, 1.0f, &doubted_angle, BELIEVED, &how.counts, (uint32_t)-1);
    bus = followed_bus(limits, measured->bus_voltage_v, state->bus_voltage_v, &how, &bad);
    speed = followed_speed(limits, measured->speed_rad_s, state->speed_rad_s, &how, &bad);

    exact_unless(exact_magnitude(off), limits->angle_rate_turns, &angle_share, doubted_angle, &bad, how.counts);
    exact_unless(exact_magnitude(turns), limits->angle_turns, &off, 0.0f, &bad, 1u);
    angle = state->angle_turns + exact_product(angle_share, off);

    const float alpha = exact_product(a - exact_product(0.5f, b + c), TWO_THIRDS);
    const float beta = exact_product(b - c, PER_ROOT_3);
    const float cos_now = cosine(angle), sin_now = cosine(angle - 0.25f);
    const float sampled_d = exact_product(cos_now, alpha) + exact_product(sin_now, beta);
    const float sampled_q = exact_product(cos_now, beta) - exact_product(sin_now, alpha);
    const float square = exact_product(sampled_d, sampled_d) + exact_product(sampled_q, sampled_q);
    float seen_d = sampled_d - state->expected_d_a, seen_q = sampled_q - state->expected_q_a, now = square;
    float taken = 1.0f, share_believed = BELIEVED;
    exact_unless_three(square, limits->current_square_a2, &seen_d, 0.0f, &seen_q, 0.0f, &now, 0.0f, &bad, 1u);
    exact_unless_three(exact_magnitude((a + b) + c), limits->current_sum_a, &seen_d, 0.0f, &seen_q, 0.0f, &now, 0.0f, &bad, 1u);
    const float seen = exact_product(seen_d, seen_d) + exact_product(seen_q, seen_q);
    exact_unless_two(seen, limits->current_rate_square_a2, &taken, open, &share_believed, open, &bad, 1u);
    const float off_d = exact_product(taken, seen_d);
    const float off_q = exact_product(taken, seen_q);
    const float i_d = state->expected_d_a + off_d;
    const float i_q = state->expected_q_a + off_q;

    const float from_d = state->expected_d_a + exact_product(share_believed, off_d);
    const float from_q = state->expected_q_a + exact_product(share_believed, off_q);
    const float turned = exact_product(drive->turned_per_speed, speed);
    const float half_d = from_d + exact_product(0.5f, move_d(drive, state, turned, from_d, from_q));
    const float half_q = from_q + exact_product(0.5f, move_q(drive, state, turned, from_d, from_q));
    float moved_d = move_d(drive, state, turned, half_d, half_q), moved_q = move_q(drive, state, turned, half_d, half_q);
    exact_replace_two(0.0f, open, &moved_d, 0.0f, &moved_q, 0.0f);
    const float expected_d = from_d + moved_d;
    const float expected_q = from_q + moved_q;

    const float then_d = expected_d + seen_d;
    const float then_q = expected_q + seen_q;
    const float then = exact_product(then_d, then_d) + exact_product(then_q, then_q);
    const uint32_t one_bad = exact_any(bad);
    const float wait = limits->good_in_a_row + PERIODS_TO_CLOSE;
    float waiting, closed;
    bad_samples_add(&state->bad, one_bad);
    waiting = exact_select(limits->trip_square_a2, exact_at_least(now, then), wait, exact_at_least(state->waiting - 1.0f, 0.0f));
    waiting = exact_select_from(state->bad.in_a_row, limits->bad_in_a_row, wait, waiting);
    waiting = exact_select(0.0f, exact_product((float)one_bad, open), wait, waiting);
    closed = exact_select(waiting, PERIODS_TO_CLOSE + 0.5f, 1.0f, 0.0f);

    {
        const float to_d = reference->i_d_a - state->reference_d_a;
        const float to_q = reference->i_q_a - state->reference_q_a;
        const float farther = exact_at_least(exact_magnitude(to_d), exact_magnitude(to_q));
        const float part = drive->slew_a / exact_at_least(farther, drive->slew_a);
        float step_d = exact_product(part, to_d), step_q = exact_product(part, to_q);
        float wanted_d_a = state->reference_d_a + step_d, wanted_q_a = state->reference_q_a + step_q;
        exact_replace_two(0.0f, open, &step_d, 0.0f, &step_q, 0.0f);
        exact_replace_two(0.0f, open, &wanted_d_a, i_d, &wanted_q_a, i_q);

        const float per_bus = 1.0f / exact_at_least(bus, limits->bus_v.middle - limits->bus_v.half);
        const float radius = exact_product(bus, PER_ROOT_3);
        const float w_e = exact_product(drive->pole_pairs, speed);
        const float error_d = wanted_d_a - i_d;
        const float error_q = wanted_q_a - i_q;
        const float model_d = (exact_product(drive->resistance_ohm, wanted_d_a) - exact_product(w_e, exact_product(drive->inductance_h, wanted_q_a)))
            + exact_product(drive->slew_v_per_a, step_d);
        const float flux = exact_product(drive->inductance_h, wanted_d_a) + drive->flux_linkage_wb;
        const float model_q = (exact_product(drive->resistance_ohm, wanted_q_a) + exact_product(w_e, flux)) + exact_product(drive->slew_v_per_a, step_q);
        const float wanted_d = (exact_product(drive->gain_v_per_a, error_d) + state->integral_d_v) + model_d;
        const float wanted_q = (exact_product(drive->gain_v_per_a, error_q) + state->integral_q_v) + model_q;

        const float per_radius = exact_product(per_bus, ROOT_3);
        float share = exact_product(exact_product(wanted_d, wanted_d) + exact_product(wanted_q, wanted_q), exact_product(per_radius, per_radius));
        const float scale = exact_select(1.0f, share, per_root(exact_at_least(share, 1.0f)), 1.0f);
        const float v_d = exact_product(scale, wanted_d);
        const float v_q = exact_product(scale, wanted_q);
        const float cross = exact_product(w_e, drive->inductance_h);
        float target_d = exact_product(drive->gain_v_per_a, error_d) - exact_product(cross, error_q);
        float target_q = exact_product(drive->gain_v_per_a, error_q) + exact_product(cross, error_d);
        exact_replace_two(1.0f, share, &target_d, -state->integral_d_v, &target_q, -state->integral_q_v);
        float integral_d = state->integral_d_v + exact_product(drive->integral_share, target_d);
        float integral_q = state->integral_q_v + exact_product(drive->integral_share, target_q);
        const float most = exact_product(INTEGRAL_SHARE, radius);

        const float later = angle + exact_product(drive->advance_turns_s, speed);
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
        const float flow_alpha = exact_product(cos_then, wanted_d_a) - exact_product(sin_then, wanted_q_a);
        const float flow_beta = exact_product(sin_then, wanted_d_a) + exact_product(cos_then, wanted_q_a);
        const float flow_half = exact_product(0.5f, flow_alpha);
        const float flow_side = exact_product(HALF_ROOT_3, flow_beta);
        state->last.duties[0] = duty(drive, v_a, centre, per_bus, flow_alpha);
        state->last.duties[1] = duty(drive, v_b, centre, per_bus, flow_side - flow_half);
        state->last.duties[2] = duty(drive, v_c, centre, per_bus, -flow_side - flow_half);
        state->last.closed = closed;

        integral_d = exact_within(integral_d, -most, most);
        integral_q = exact_within(integral_q, -most, most);
        exact_replace_three(0.0f, open, &integral_d, 0.0f, &integral_q, 0.0f, &share, 0.0f);
        state->integral_d_v = integral_d;
        state->integral_q_v = integral_q;
        state->reference_d_a = wanted_d_a;
        state->reference_q_a = wanted_q_a;
        state->v_d_v = v_d;
        state->v_q_v = v_q;
        state->expected_d_a = expected_d;
        state->expected_q_a = expected_q;
        state->angle_turns = part_of_turn(angle + exact_product(drive->turns_per_speed, speed));
        state->speed_rad_s = speed;
        state->bus_voltage_v = bus;
        state->waiting = waiting;
        state->voltage_share = share;
    }
}
