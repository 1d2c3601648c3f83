/* Prints a running hash of every bit that the steps give along a long pseudo-random sequence.
 *
 * In: nothing; the sequence comes from a fixed seed. Out: a line every 2048 ticks. tests/all/firmware.rs has the same sequence and steps in Rust, and
 * compares the lines. One number in 32 is any bit pattern: NaN, infinities and subnormals are among them.
 */
#include <stdio.h>

#include "motor_step.h"
#include "tables.h"
#include "throttle_step.h"

#define TICKS 65536u
#define TICKS_A_LINE 2048u

static uint32_t random_state = 0x2545F491u;

/* Marsaglia, "Xorshift RNGs" (2003): 13, 17, 5. */
static uint32_t next_random(void)
{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 17;
    random_state ^= random_state << 5;
    return random_state;
}

static float number(float low, float span)
{
    const uint32_t kind = next_random() & 31u;
    const uint32_t bits = next_random();
    float any;
    if (kind == 0u) {
        __builtin_memcpy(&any, &bits, sizeof any);
        return any;
    }
    /* 24 bits are a float exactly; 2^-24. */
    return low + exact_product(exact_product((float)(bits >> 8), 5.9604644775390625e-8f), span);
}

static uint32_t hash = 2166136261u;

/* FNV-1a (Fowler, Noll, Vo), by words. */
static void add_word(uint32_t word)
{
    hash = (hash ^ word) * 16777619u;
}

static void add(float value)
{
    uint32_t bits;
    __builtin_memcpy(&bits, &value, sizeof bits);
    add_word(bits);
}

static void line(const char *name, uint32_t tick)
{
    if ((tick + 1u) % TICKS_A_LINE == 0u) {
        printf("%s %lu %08lx\n", name, (unsigned long)(tick + 1u), (unsigned long)hash);
    }
}

/* A number that stays what it is nearly always, and then moves by up to half of `span` either way, or is any bit pattern for one sample. */
static float wander(float *held, float low, float high, float span)
{
    const uint32_t kind = next_random() & 255u;
    const uint32_t bits = next_random();
    float any;
    if (kind == 0u) {
        __builtin_memcpy(&any, &bits, sizeof any);
        return any;
    }
    *held = exact_within(*held + exact_product(exact_product((float)(bits >> 8), 5.9604644775390625e-8f) - 0.5f, span), low, high);
    return *held;
}

static void motor(void)
{
    motor_reference_state outer;
    motor_current_state inner;
    uint32_t tick, k, any_currents = 0u, open = 0u;
    float torque = 0.0f, wide_speed = 0.0f, speed = 0.0f, bus = 270.0f, angle = 0.0f;
    motor_reference_init(&outer);
    motor_current_init(&inner);
    for (tick = 0u; tick < TICKS; tick++) {
        motor_measured measured;
        if (tick % 10u == 0u) {
            motor_demand demand;
            demand.torque_nm = wander(&torque, -30.0f, 30.0f, 10.0f);
            demand.speed_rad_s = wander(&wide_speed, -1050.0f, 1050.0f, 60.0f);
            demand.bus_voltage_v = wander(&bus, 140.0f, 370.0f, 20.0f);
            demand.voltage_share = number(0.0f, 1.3f);
            motor_references(&outer, &tables_drive, &demand);
            add(outer.last.i_d_a);
            add(outer.last.i_q_a);
            add(outer.trim_a);
            add(outer.speed_rad_s);
        }
        if (tick % 64u == 0u) {
            /* Now and then anything, else what the model expects. */
            any_currents = (next_random() & 15u) == 0u;
        }
        /* Any vector of up to 40 A; or the expected one, turned back by the angle to come, and a little beside it: so the bridge stays closed. */
        if (any_currents) {
            for (k = 0u; k < 3u; k++) {
                measured.currents_a[k] = number(-40.0f, 80.0f);
            }
        } else {
            measured.currents_a[0] = inner.expected_d_a + number(-1.0f, 2.0f);
            measured.currents_a[1] = exact_product(0.8660254f, inner.expected_q_a) - exact_product(0.5f, inner.expected_d_a);
            measured.currents_a[2] = -measured.currents_a[1] - inner.expected_d_a;
        }
        measured.speed_rad_s = wander(&speed, -30.0f, 30.0f, 4.0f);
        measured.bus_voltage_v = wander(&bus, 140.0f, 370.0f, 4.0f);
        measured.angle_turns = wander(&angle, -0.02f, 0.02f, 0.004f);
        motor_currents(&inner, &tables_drive, &outer.last, &measured);
        add(inner.integral_d_v);
        add(inner.integral_q_v);
        add(inner.expected_d_a);
        add(inner.voltage_share);
        for (k = 0u; k < 3u; k++) {
            add(inner.last.duties[k]);
        }
        add(inner.last.closed);
        open += inner.last.closed < 0.5f;
        add_word(open);
        add_word(outer.bad.all);
        add_word(inner.bad.all);
        add_word(inner.bad.in_a_row);
        line("motor", tick);
    }
}

static void throttle(void)
{
    throttle_state state;
    throttle_inputs inputs = {0.0f, 0.0f, 0u, 0u};
    uint32_t tick, torn = 0u;
    float speed = 10.0f;
    throttle_init(&state);
    for (tick = 0u; tick < TICKS; tick++) {
        inputs.pedal = number(-0.1f, 1.2f);
        inputs.speed_m_s = wander(&speed, 0.0f, 40.0f, 2.5f);
        /* Gear, clutch and a torn wire stay for some time, so that shares fade, gears move and the throttle closes all the way. */
        if ((next_random() & 255u) == 0u) {
            inputs.gear = next_random() & 7u;
            inputs.clutch = next_random() & 1u;
            torn = (next_random() & 7u) == 0u;
        }
        if (torn) {
            inputs.pedal = 3.0f;
        }
        add(throttle_step(&state, &inputs));
        add(state.share);
        add(state.cap);
        add_word(state.bad.all);
        add_word(state.bad.in_a_row);
        line("throttle", tick);
    }
}

static void raw(void)
{
    throttle_raw_state state;
    throttle_counts counts = {0u, 0u, 0u, 0u};
    uint32_t tick, torn = 0u, compare = 180u;
    throttle_raw_init(&state);
    for (tick = 0u; tick < TICKS; tick++) {
        const uint32_t wide = (next_random() & 31u) == 0u ? 0xFFFFu : 0xFFFu;
        counts.pedal = (uint16_t)(next_random() & wide);
        counts.speed = (uint16_t)(next_random() & wide);
        if ((next_random() & 255u) == 0u) {
            /* One of six lines in three of four cases, else any pattern. */
            const uint32_t one = 1u << (next_random() % 6u);
            const uint32_t any = next_random();
            counts.lines = (next_random() & 3u) != 0u ? one : any;
            torn = (next_random() & 3u) == 0u;
        }
        /* The plate follows, or its wire is torn. */
        counts.plate = (uint16_t)((compare - 180u) * 3276u / 3240u + 410u);
        if (torn) {
            counts.plate = 0u;
        }
        compare = throttle_raw_step(&state, &tables_scaling, &counts);
        add_word(compare);
        add(state.step.cap);
        add_word(state.step.bad.all);
        add_word(state.plate.all);
        add_word(state.plate.in_a_row);
        line("raw", tick);
    }
}

int main(void)
{
    motor();
    throttle();
    raw();
    return 0;
}
