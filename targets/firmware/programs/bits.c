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

static void motor(void)
{
    motor_reference_state outer;
    motor_current_state inner;
    uint32_t tick, k;
    motor_reference_init(&outer);
    motor_current_init(&inner);
    for (tick = 0u; tick < TICKS; tick++) {
        motor_measured measured;
        if (tick % 10u == 0u) {
            motor_demand demand;
            demand.torque_nm = number(-25.0f, 50.0f);
            demand.speed_rad_s = number(-850.0f, 1700.0f);
            demand.bus_voltage_v = number(200.0f, 100.0f);
            motor_references(&outer, &tables_drive, &demand);
            add(outer.last.i_d_a);
            add(outer.last.i_q_a);
            add(outer.last.resistive_d_v);
            add(outer.last.resistive_q_v);
        }
        for (k = 0u; k < 3u; k++) {
            measured.currents_a[k] = number(-70.0f, 140.0f);
        }
        measured.angle_turns = number(-2.0f, 5.0f);
        measured.speed_rad_s = number(-850.0f, 1700.0f);
        measured.bus_voltage_v = number(200.0f, 100.0f);
        motor_currents(&inner, &tables_drive, &outer.last, &measured);
        add(inner.integral_d_v);
        add(inner.integral_q_v);
        for (k = 0u; k < 3u; k++) {
            add(inner.last[k]);
        }
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
    uint32_t tick;
    throttle_init(&state);
    for (tick = 0u; tick < TICKS; tick++) {
        inputs.pedal = number(-0.1f, 1.2f);
        inputs.speed_m_s = number(0.0f, 40.0f);
        /* Gear and clutch stay for some time, so that shares fade and gears move all the way. */
        if ((next_random() & 255u) == 0u) {
            inputs.gear = next_random() & 7u;
            inputs.clutch = next_random() & 1u;
        }
        add(throttle_step(&state, &inputs));
        add(state.share);
        add_word(state.bad.all);
        add_word(state.bad.in_a_row);
        line("throttle", tick);
    }
}

static void raw(void)
{
    throttle_raw_state state;
    throttle_counts counts = {0u, 0u, 0u, 0u};
    uint32_t tick;
    throttle_raw_init(&state);
    for (tick = 0u; tick < TICKS; tick++) {
        const uint32_t wide = (next_random() & 31u) == 0u ? 0xFFFFu : 0xFFFu;
        counts.pedal = (uint16_t)(next_random() & wide);
        counts.plate = (uint16_t)(next_random() & wide);
        counts.speed = (uint16_t)(next_random() & wide);
        if ((next_random() & 255u) == 0u) {
            /* One of six lines in three of four cases, else any pattern. */
            const uint32_t one = 1u << (next_random() % 6u);
            const uint32_t any = next_random();
            counts.lines = (next_random() & 3u) != 0u ? one : any;
        }
        add_word(throttle_raw_step(&state, &tables_scaling, &counts));
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
