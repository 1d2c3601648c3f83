/* Counts the instructions of every step, for inputs of every kind, on the emulated board under `-icount shift=6`.
 *
 * Out: a line a step and kind, "STEP KIND INSTRUCTIONS", the call included. An instruction then takes 64 ns of the emulated time, and the timer of
 * the board ticks every 40 ns: instructions = ticks * 40/64. These are instructions, not cycles.
 */
#include <stdio.h>

#include "motor_step.h"
#include "tables.h"
#include "throttle_step.h"

/* CMSDK APB timer 0 (Arm Cortex-M System Design Kit, technical reference manual, 4.2), counts down. */
#define TIMER_CONTROL (*(volatile uint32_t *)0x40000000u)
#define TIMER_VALUE (*(volatile uint32_t *)0x40000004u)
#define TIMER_RELOAD (*(volatile uint32_t *)0x40000008u)

/* So many calls that a tick of the timer is less than a thousandth of an instruction a call. */
#define CALLS 1000u

static motor_reference_state outer;
static motor_current_state inner;
static motor_demand demand;
static motor_measured measured;
static throttle_state state;
static throttle_inputs inputs;
static throttle_raw_state raw_state;
static throttle_counts counts;

static void call_references(void)
{
    motor_references(&outer, &tables_drive, &demand);
}

static void call_currents(void)
{
    motor_currents(&inner, &tables_drive, &outer.last, &measured);
}

static void call_throttle(void)
{
    (void)throttle_step(&state, &inputs);
}

static void call_raw(void)
{
    (void)throttle_raw_step(&raw_state, &tables_scaling, &counts);
}

/* The same call with nothing behind it. */
static void call_nothing(void)
{
    __asm__ volatile("" : : : "memory");
}

static uint32_t ticks_of(void (*volatile call)(void))
{
    uint32_t k, before, after;
    TIMER_CONTROL = 0u;
    TIMER_RELOAD = 0xFFFFFFFFu;
    TIMER_VALUE = 0xFFFFFFFFu;
    TIMER_CONTROL = 1u;
    before = TIMER_VALUE;
    for (k = 0u; k < CALLS; k++) {
        call();
    }
    after = TIMER_VALUE;
    return before - after;
}

static void print(const char *step, const char *kind, void (*call)(void))
{
    const uint32_t ticks = ticks_of(call) - ticks_of(call_nothing);
    /* Rounded to the nearest instruction. */
    printf("%s %s %lu\n", step, kind, (unsigned long)((ticks * 40u / 64u + CALLS / 2u) / CALLS));
}

static float of_bits(uint32_t bits)
{
    float value;
    __builtin_memcpy(&value, &bits, sizeof value);
    return value;
}

static void all_floats(const char *kind, float value)
{
    demand.torque_nm = demand.speed_rad_s = demand.bus_voltage_v = demand.voltage_share = value;
    measured.currents_a[0] = measured.currents_a[1] = measured.currents_a[2] = value;
    measured.angle_turns = measured.speed_rad_s = measured.bus_voltage_v = value;
    inputs.pedal = inputs.speed_m_s = value;
    print("motor_references", kind, call_references);
    print("motor_currents", kind, call_currents);
    print("throttle_step", kind, call_throttle);
}

static void raw_counts(const char *kind, uint16_t value, uint32_t lines)
{
    counts.pedal = counts.plate = counts.speed = value;
    counts.lines = lines;
    print("throttle_raw_step", kind, call_raw);
}

int main(void)
{
    motor_reference_init(&outer);
    motor_current_init(&inner);
    throttle_init(&state);
    throttle_raw_init(&raw_state);
    inputs.gear = 2u;
    all_floats("zero", 0.0f);
    all_floats("one", 1.0f);
    all_floats("ordinary", 37.3f);
    all_floats("negative", -37.3f);
    all_floats("large", 1e30f);
    all_floats("subnormal", of_bits(1u));
    all_floats("nan", of_bits(0x7FC00000u));
    all_floats("infinite", of_bits(0x7F800000u));
    inputs.gear = 5u;
    all_floats("another_gear", 12.0f);
    inputs.gear = 200u;
    all_floats("no_gear", 12.0f);
    inputs.clutch = 1u;
    all_floats("clutch", 12.0f);
    raw_counts("lowest", 0u, 0u);
    raw_counts("middle", 2048u, 4u);
    raw_counts("highest", 4095u, 16u);
    raw_counts("clutch", 1000u, 34u);
    raw_counts("torn", 65535u, 0xFFFFFFFFu);
    return 0;
}
