/* The processor in the loop: the image of both loops on the board, its interrupts and priorities, against the plants of rig.c.
 *
 * The plants take the place of converters and power stage: they move when the firmware samples. The board runs by its timers, under `-icount shift=0`, where a
 * period of 0.1 ms has room for a plant in software double precision. The host has no interrupts: there the same calls stand in the order that the board
 * must have. The lines must be the same, bit for bit.
 *
 * -DPREEMPTED: the outer interrupt begins so late in a period that the inner one of the next period interrupts its step. Without, the inner one interrupts
 * the plant of the car.
 *
 * Out: a line a period, "motor INPUTS OUTPUTS", and a line a millisecond, "car INPUTS OUTPUTS", as in rig.c. On the board also how often the
 * outer interrupt was interrupted, periods that were lost, bytes of stack, and the floating-point context.
 */
#include <stdio.h>

#include "image.h"
#include "rig_car.h"
#include "rig_motor.h"

#define PERIODS 600u
#define MOTOR_STEPS 1u
#define CAR_STEPS 10u

static image_state image;
static rig_motor_state motor;
static rig_car_state car;
/* In force, and what is loaded at the next period. */
static double duties[3] = {0.5, 0.5, 0.5}, next_duties[3] = {0.5, 0.5, 0.5};
static double throttle = 0.2, next_throttle = 0.2;
static uint16_t compare = 828u;
static double periods[PERIODS][8];
static double milliseconds[PERIODS / IMAGE_PERIODS][4];
static uint32_t sampled, counted;

void board_sample(motor_measured *measured)
{
    rig_motor_outputs shown;
    uint32_t k;
    if (sampled > 0u) {
        for (k = 1u; k < MOTOR_STEPS; k++) {
            rig_motor_step(&motor, duties[0], duties[1], duties[2], &shown);
        }
    }
    for (k = 0u; k < 3u; k++) {
        duties[k] = next_duties[k];
    }
    rig_motor_step(&motor, duties[0], duties[1], duties[2], &shown);
    measured->currents_a[0] = (float)shown.current_a;
    measured->currents_a[1] = (float)shown.current_b;
    measured->currents_a[2] = (float)shown.current_c;
    measured->angle_turns = (float)shown.turns;
    measured->speed_rad_s = (float)shown.speed;
    measured->bus_voltage_v = 270.0f;
    if (sampled < PERIODS) {
        double *row = periods[sampled];
        for (k = 0u; k < 3u; k++) {
            row[k] = duties[k];
        }
        row[3] = shown.current_a;
        row[4] = shown.current_b;
        row[5] = shown.current_c;
        row[6] = shown.turns;
        row[7] = shown.speed;
    }
    sampled++;
}

void board_command(const motor_command *command)
{
    uint32_t k;
    for (k = 0u; k < 3u; k++) {
        next_duties[k] = command->closed > 0.5f ? (double)command->duties[k] : 0.5;
    }
}

float board_torque_demand(void)
{
    return counted < 30u ? 6.0f : -4.0f;
}

void board_counts(throttle_counts *counts)
{
    rig_car_outputs shown;
    uint32_t k;
    if (counted > 0u) {
        for (k = 1u; k < CAR_STEPS; k++) {
            rig_car_step(&car, throttle, &shown);
        }
    }
    throttle = next_throttle;
    rig_car_step(&car, throttle, &shown);
    /* 12 bits for 60 m/s; the pedal from 20 % to 80 %; the plate where it was told to be; first gear. */
    counts->speed = (uint16_t)(shown.road_speed * (4095.0 / 60.0) + 0.5);
    counts->pedal = counted < 20u ? 1065u : 3030u;
    counts->plate = (uint16_t)((compare - 180u) * 3276u / 3240u + 410u);
    counts->lines = 1u;
    if (counted < sizeof milliseconds / sizeof milliseconds[0]) {
        milliseconds[counted][0] = throttle;
        milliseconds[counted][1] = shown.engine_speed;
        milliseconds[counted][2] = shown.road_speed;
        milliseconds[counted][3] = shown.acceleration;
    }
    counted++;
}

void board_throttle(uint16_t told, float cap)
{
    (void)cap;
    compare = told;
    next_throttle = (double)(told - 180u) / 3240.0;
}

static void print(double value)
{
    uint32_t words[2];
    __builtin_memcpy(words, &value, sizeof words);
    /* Both machines have the low word first. */
    printf(" %08lx%08lx", (unsigned long)words[1], (unsigned long)words[0]);
}

static void print_all(void)
{
    uint32_t row, k;
    for (row = 0u; row < PERIODS; row++) {
        printf("motor");
        for (k = 0u; k < 8u; k++) {
            print(periods[row][k]);
        }
        printf("\n");
    }
    for (row = 0u; row < PERIODS / IMAGE_PERIODS; row++) {
        printf("car");
        for (k = 0u; k < 4u; k++) {
            print(milliseconds[row][k]);
        }
        printf("\n");
    }
}

#if defined(__arm__)
#include "an386.h"

#define PERIOD_TICKS (TICKS_A_SECOND / 10000u)
/* 200 instructions at 40 a tick: the outer interrupt has taken its samples, and is in the middle of its step. */
#define EARLY_TICKS 5u
/* Three milliseconds without a feed. */
#define WATCHDOG_TICKS (3u * TICKS_A_SECOND / 1000u)
#define PAINT 0xA5A5A5A5u
#define PAINTED_WORDS 4096u

static volatile uint32_t done, in_references, preempted, lost;

void watchdog_alarm(void);
void timer0_interrupt(void);
void timer1_interrupt(void);

void board_feed_watchdog(void)
{
    an386_feed_watchdog();
}

/* Here it would be a fault: the lines then lack, and no run ends like that. */
void watchdog_alarm(void)
{
    image_safe_state();
    printf("watchdog\n");
    done = 1u;
}

void timer0_interrupt(void)
{
    TIMER_CLEAR(TIMER0) = 1u;
    preempted += in_references;
    if (sampled < PERIODS) {
        image_current_interrupt(&image);
    } else {
        done = 1u;
    }
    /* Set again already: this period took longer than it lasts. */
    lost += TIMER_CLEAR(TIMER0) & 1u;
}

void timer1_interrupt(void)
{
    TIMER_CLEAR(TIMER1) = 1u;
    in_references = 1u;
    if (!done) {
        image_reference_interrupt(&image);
    }
    in_references = 0u;
    lost += TIMER_CLEAR(TIMER1) & 1u;
}

static void run(void)
{
    uint32_t *const top = (uint32_t *)__builtin_frame_address(0) - 64;
    uint32_t k, unused = 0u;
    for (k = 1u; k <= PAINTED_WORDS; k++) {
        *(volatile uint32_t *)(top - k) = PAINT;
    }
    an386_start_watchdog(WATCHDOG_TICKS);
    an386_start(TIMER0, TIMER0_NUMBER, PRIORITY_CURRENTS, PERIOD_TICKS);
    an386_start(TIMER1, TIMER1_NUMBER, PRIORITY_REFERENCES, PERIOD_TICKS * IMAGE_PERIODS);
#if defined(PREEMPTED)
    /* The first time just before the second period, then every ten periods. */
    TIMER_VALUE(TIMER1) = 2u * PERIOD_TICKS - EARLY_TICKS;
#else
    /* In the first period, as soon as the currents are controlled. */
    TIMER_VALUE(TIMER1) = PERIOD_TICKS;
#endif
    /* A board may sleep here (wfi). The emulator's clock then leaves the count of instructions, and periods are lost. */
    while (!done) {
    }
    TIMER_CONTROL(TIMER0) = 0u;
    TIMER_CONTROL(TIMER1) = 0u;
    WATCHDOG_LOCK = WATCHDOG_KEY;
    WATCHDOG_CONTROL = 0u;
    while (unused < PAINTED_WORDS && *(volatile uint32_t *)(top - PAINTED_WORDS + unused) == PAINT) {
        unused++;
    }
    print_all();
    printf("board preempted %lu lost %lu fpccr %08lx stack %lu\n", (unsigned long)preempted, (unsigned long)lost, (unsigned long)FPCCR,
           (unsigned long)(4u * (PAINTED_WORDS - unused)));
}
#else

void board_feed_watchdog(void)
{
}

static void run(void)
{
    uint32_t period;
    for (period = 0u; period < PERIODS; period++) {
#if defined(PREEMPTED)
        if (period % IMAGE_PERIODS == 1u) {
            /* Begun before this period from the samples of the last one, ended in it: what the outer step gives is in force from the next one on. */
            const image_references before = image.reference;
            image_references after;
            image_reference_interrupt(&image);
            after = image.reference;
            image.reference = before;
            image_current_interrupt(&image);
            image.reference = after;
        } else {
            image_current_interrupt(&image);
        }
#else
        image_current_interrupt(&image);
        if (period % IMAGE_PERIODS == 0u) {
            image_reference_interrupt(&image);
        }
#endif
    }
    print_all();
}
#endif

int main(void)
{
    image_init(&image);
    rig_motor_init(&motor);
    rig_car_init(&car);
    run();
    return 0;
}
