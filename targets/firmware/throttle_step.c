/* The steps of targets/throttle-loop: src/step.rs and src/raw.rs say why each is as it is. The bits are theirs; one comparison does here what several selections ask there. */
#include "throttle_step.h"

/* The evaluators as source: see EXACT_FLATTEN. */
#include "driveline.c"

#define FADE_PER_TICK 0.01f
#define GEAR_PER_TICK 0.02f
#define HOLD_TICKS 50.0f
#define CLOSE_PER_TICK 0.004f
#define REOPEN_PER_TICK 0.001f
#define PEDAL_BAND 1.5f
#define SPEED_BAND 100.0f
#define SPEED_PER_TICK 2.0f
#define PLATE_TOLERANCE 0.1f
#define PLATE_TICKS 100.0f

void throttle_init(throttle_state *state)
{
    driveline_tip_in_init_f32(&state->compensator);
    state->pedal = 0.0f;
    state->speed_m_s = 0.0f;
    state->gear = 1.0f;
    state->share = 0.0f;
    state->lost = 0.0f;
    state->cap = 1.0f;
    state->bad.all = 0u;
    state->bad.in_a_row = 0u;
}

void throttle_raw_init(throttle_raw_state *state)
{
    throttle_init(&state->step);
    state->throttle = 0.0f;
    state->closing = 0.0f;
    state->plate.all = 0u;
    state->plate.in_a_row = 0u;
}

EXACT_INLINE float advance(throttle_state *state, const throttle_inputs *inputs, float fault)
{
    uint32_t bad = 0u, speed_bad = 0u, no_gear = 0u, above = 0u, counts = 1u;
    float pedal = exact_within(inputs->pedal, 0.0f, 1.0f), lost = 0.0f;
    exact_unless_two(exact_magnitude(inputs->pedal - 0.5f), PEDAL_BAND, &pedal, state->pedal, &lost, state->lost + 1.0f, &bad, 1u);
    const float shut = exact_at_least(exact_at_most(state->cap, state->pedal) - CLOSE_PER_TICK, 0.0f);
    float cap = exact_select(HOLD_TICKS, lost, shut, exact_at_most(state->cap + REOPEN_PER_TICK, 1.0f));
    /* The step in physical units knows of no other fault, and the compiler knows that. */
    if (!(__builtin_constant_p(0.0f < fault) && !(0.0f < fault))) {
        cap = exact_select(0.0f, fault, shut, cap);
    }
    pedal = exact_at_most(pedal, cap);

    const float road = exact_magnitude(inputs->speed_m_s);
    float speed = road, kept = state->speed_m_s;
    /* While there is no share any speed in the range is taken. */
    exact_unless(0.0f, state->share, &kept, road, &counts, (uint32_t)-1);
    exact_unless(exact_magnitude(road - state->speed_m_s), SPEED_PER_TICK, &speed, kept, &speed_bad, counts);
    exact_unless(road, SPEED_BAND, &speed, state->speed_m_s, &speed_bad, 1u);

    const float lever = (float)inputs->gear;
    float wanted_gear = lever;
    exact_unless(0.0f, lever, &wanted_gear, state->gear, &no_gear, 1u);
    exact_unless(lever, (float)THROTTLE_GEARS + 0.5f, &wanted_gear, state->gear, &above, 1u);
    const float gear = state->gear + exact_within(wanted_gear - state->gear, -GEAR_PER_TICK, GEAR_PER_TICK);

    const uint32_t supported = (uint32_t)driveline_damping_ratio_support_f32(speed, gear);
    const uint32_t known = exact_any(speed_bad + no_gear + above + inputs->clutch) ^ 1u;
    const float share = state->share + exact_within((float)(known & supported) - state->share, -FADE_PER_TICK, FADE_PER_TICK);

    const float compensated = driveline_tip_in_step_f32(&state->compensator, pedal, speed, gear);
    const float throttle = exact_within(pedal + exact_product(share, compensated - pedal), 0.0f, cap);

    state->pedal = pedal;
    state->speed_m_s = speed;
    state->gear = gear;
    state->share = share;
    state->lost = lost;
    state->cap = cap;
    bad_samples_add(&state->bad, bad + speed_bad + above);
    return throttle;
}

EXACT_FLATTEN float throttle_step(throttle_state *state, const throttle_inputs *inputs)
{
    return advance(state, inputs, 0.0f);
}

EXACT_INLINE float value(const throttle_channel *channel, uint16_t counts)
{
    const float number = (float)counts;
    const float scaled = exact_product(number - channel->zero, channel->per_count);
    const float not_low = exact_select(number, channel->lowest, __builtin_nanf(""), scaled);
    return exact_select(channel->highest, number, __builtin_nanf(""), not_low);
}

/* All ones where bits is not 0, else 0. */
EXACT_INLINE uint32_t mask_of(uint32_t bits)
{
    return exact_opaque((uint32_t)0 - ((bits | ((uint32_t)0 - bits)) >> 31));
}

EXACT_INLINE uint32_t gear_of(uint32_t lines)
{
    const uint32_t gears = lines & (THROTTLE_CLUTCH_LINE - 1u);
    const uint32_t number = (gears & 1u) + (gears & 2u) + 3u * (gears >> 2 & 1u) + 4u * (gears >> 3 & 1u) + 5u * (gears >> 4);
    const uint32_t several = gears & (gears - 1u);
    return (number | mask_of(several | lines >> (THROTTLE_GEARS + 1u))) & 255u;
}

EXACT_FLATTEN uint16_t throttle_raw_step(throttle_raw_state *state, const throttle_scaling *scaling, const throttle_counts *counts)
{
    throttle_inputs inputs;
    float deviation, still, fault, throttle;
    inputs.pedal = value(&scaling->pedal, counts->pedal);
    inputs.speed_m_s = value(&scaling->speed, counts->speed);
    inputs.gear = gear_of(counts->lines);
    inputs.clutch = counts->lines >> THROTTLE_GEARS & 1u;
    deviation = exact_magnitude(value(&scaling->plate, counts->plate) - state->throttle);
    still = exact_select(0.0f, state->step.cap, state->closing, 0.0f);
    fault = exact_select(PLATE_TICKS, (float)state->plate.in_a_row, 1.0f, still);
    state->closing = fault;
    throttle = advance(&state->step, &inputs, fault);
    /* Good where the deviation is at most the tolerance: a number, and the tolerance not below it. */
    bad_samples_count(&state->plate, exact_less(exact_nothing(deviation), 1.0f) & (exact_less(PLATE_TOLERANCE, deviation) ^ 1u));
    state->throttle = throttle;
    return (uint16_t)((scaling->compare_closed + exact_product(scaling->compare_span, throttle)) + 0.5f);
}
