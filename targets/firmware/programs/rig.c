/* A hardware-in-the-loop rig in one file: both loops of the firmware against plants that `rsm emit` wrote, in one program.
 *
 * rig_motor: rig/motor.mo in steps of 20 us; rig_car: `rsm:driveline` in steps of 0.1 ms. In each cycle the first step of the plant shows what the sensors read
 * at the beginning of the cycle; the firmware computes its command; the command acts from the next cycle on, as it does on a board.
 *
 * Out: a line a cycle, "NAME INPUTS OUTPUTS": the inputs of the plant in the cycle, then its outputs at the beginning, as bits of doubles. On the emulated
 * board also "NAME-instructions N": instructions of a step of the plant, the mean over the run.
 */
#include <stdio.h>

#include "motor_step.h"
#include "rig_car.h"
#include "rig_motor.h"
#include "tables.h"
#include "throttle_step.h"

#define MOTOR_CYCLES 400u
#define MOTOR_STEPS 5u
#define CAR_CYCLES 600u
#define CAR_STEPS 10u

static void print(double value)
{
    uint32_t words[2];
    __builtin_memcpy(words, &value, sizeof words);
    /* Both machines have the low word first. */
    printf(" %08lx%08lx", (unsigned long)words[1], (unsigned long)words[0]);
}

#if defined(__arm__)
/* The timer of count.c: under `-icount shift=6` an instruction takes 64 ns, and a tick is 40 ns. */
#define TIMER_CONTROL (*(volatile uint32_t *)0x40000000u)
#define TIMER_VALUE (*(volatile uint32_t *)0x40000004u)
#define TIMER_RELOAD (*(volatile uint32_t *)0x40000008u)

static void begin(void)
{
    TIMER_CONTROL = 0u;
    TIMER_RELOAD = 0xFFFFFFFFu;
    TIMER_VALUE = 0xFFFFFFFFu;
    TIMER_CONTROL = 1u;
}

static uint32_t now(void)
{
    return TIMER_VALUE;
}

static void tell(const char *name, uint32_t ticks, uint32_t steps)
{
    printf("%s-instructions %lu\n", name, (unsigned long)((uint64_t)ticks * 40u / 64u / steps));
}
#else
static void begin(void)
{
}

static uint32_t now(void)
{
    return 0u;
}

static void tell(const char *name, uint32_t ticks, uint32_t steps)
{
    (void)name;
    (void)ticks;
    (void)steps;
}
#endif

static void run_motor(void)
{
    static motor_reference_state outer;
    static motor_current_state inner;
    static rig_motor_state plant;
    rig_motor_outputs shown, later;
    /* All legs at one half: no voltage. */
    double duties[3] = {0.5, 0.5, 0.5};
    uint32_t cycle, step, ticks = 0u;
    motor_reference_init(&outer);
    motor_current_init(&inner);
    rig_motor_init(&plant);
    for (cycle = 0u; cycle < MOTOR_CYCLES; cycle++) {
        motor_measured measured;
        uint32_t before;
        rig_motor_step(&plant, duties[0], duties[1], duties[2], &shown);
        measured.currents_a[0] = (float)shown.current_a;
        measured.currents_a[1] = (float)shown.current_b;
        measured.currents_a[2] = (float)shown.current_c;
        measured.angle_turns = (float)shown.turns;
        measured.speed_rad_s = (float)shown.speed;
        measured.bus_voltage_v = 270.0f;
        if (cycle % 10u == 0u) {
            motor_demand demand;
            demand.torque_nm = cycle < 200u ? 6.0f : -4.0f;
            demand.speed_rad_s = measured.speed_rad_s;
            demand.bus_voltage_v = measured.bus_voltage_v;
            demand.voltage_share = inner.voltage_share;
            motor_references(&outer, &tables_drive, &demand);
        }
        motor_currents(&inner, &tables_drive, &outer.last, &measured);
        before = now();
        for (step = 1u; step < MOTOR_STEPS; step++) {
            rig_motor_step(&plant, duties[0], duties[1], duties[2], &later);
        }
        ticks += before - now();
        printf("motor");
        for (step = 0u; step < 3u; step++) {
            print(duties[step]);
            duties[step] = inner.last.closed > 0.5f ? (double)inner.last.duties[step] : 0.5;
        }
        print(shown.current_a);
        print(shown.current_b);
        print(shown.current_c);
        print(shown.turns);
        print(shown.speed);
        printf("\n");
    }
    tell("motor", ticks, MOTOR_CYCLES * (MOTOR_STEPS - 1u));
}

static void run_car(void)
{
    static throttle_state state;
    static rig_car_state plant;
    rig_car_outputs shown, later;
    double throttle = 0.2;
    uint32_t cycle, step, ticks = 0u;
    throttle_init(&state);
    rig_car_init(&plant);
    for (cycle = 0u; cycle < CAR_CYCLES; cycle++) {
        throttle_inputs inputs;
        uint32_t before;
        float next;
        rig_car_step(&plant, throttle, &shown);
        /* The driver tips in after 0.1 s. */
        inputs.pedal = cycle < 100u ? 0.2f : 0.8f;
        inputs.speed_m_s = (float)shown.road_speed;
        inputs.gear = 1u;
        inputs.clutch = 0u;
        next = throttle_step(&state, &inputs);
        before = now();
        for (step = 1u; step < CAR_STEPS; step++) {
            rig_car_step(&plant, throttle, &later);
        }
        ticks += before - now();
        printf("car");
        print(throttle);
        print(shown.engine_speed);
        print(shown.road_speed);
        print(shown.acceleration);
        printf("\n");
        throttle = (double)next;
    }
    tell("car", ticks, CAR_CYCLES * (CAR_STEPS - 1u));
}

int main(void)
{
    begin();
    run_motor();
    run_car();
    return 0;
}
