/* What the watchdog does when a step does not return, or no longer runs.
 *
 * -DHANG=1: the interrupt of the currents does not return. 2: that of the references does not. 3: the timer of the currents stops. 0: nothing hangs; the watchdog stays quiet.
 * After 20 ms one of these comes. The watchdog's first alarm opens the bridge, the second one resets; the start after it stays in the safe state.
 *
 * Out: what happened, a line each; "sampled" counts the periods of the currents.
 */
#include <stdio.h>
#include <stdlib.h>

#include "an386.h"
#include "image.h"

#if !defined(HANG)
#define HANG 0
#endif

#define PERIOD_TICKS (TICKS_A_SECOND / 10000u)
#define WATCHDOG_TICKS (3u * TICKS_A_SECOND / 1000u)
#define RUN_PERIODS 200u
#define SAYS_ALARM 0x616C6172u

static image_state image;
static volatile uint32_t sampled, done;
static volatile float closed = 1.0f, cut = 1.0f;
/* A board reads the cause of a reset from a register; this one has none. A reset leaves memory as it is. */
__attribute__((section(".kept"))) static volatile uint32_t left_by_alarm;

void watchdog_alarm(void);
void timer0_interrupt(void);
void timer1_interrupt(void);

static void hang(void)
{
    for (;;) {
        __asm__ volatile("");
    }
}

void board_sample(motor_measured *measured)
{
    uint32_t k;
    if (HANG == 1 && sampled == RUN_PERIODS) {
        hang();
    }
    for (k = 0u; k < 3u; k++) {
        measured->currents_a[k] = 0.0f;
    }
    measured->angle_turns = 0.0f;
    measured->speed_rad_s = 0.0f;
    measured->bus_voltage_v = 270.0f;
    sampled++;
}

void board_command(const motor_command *command)
{
    closed = command->closed;
}

float board_torque_demand(void)
{
    if (HANG == 2 && sampled >= RUN_PERIODS) {
        hang();
    }
    return 0.0f;
}

void board_counts(throttle_counts *counts)
{
    counts->pedal = 500u;
    counts->plate = 500u;
    counts->speed = 0u;
    counts->lines = 1u;
}

void board_throttle(uint16_t compare, float cap)
{
    (void)compare;
    cut = cap;
}

void board_feed_watchdog(void)
{
    an386_feed_watchdog();
}

void watchdog_alarm(void)
{
    printf("alarm: closed %d cap %d sampled %lu\n", closed > 0.5f, cut > 0.5f, (unsigned long)sampled);
    image_safe_state();
    printf("safe: closed %d cap %d\n", closed > 0.5f, cut > 0.5f);
    left_by_alarm = SAYS_ALARM;
    /* The watchdog counts on, and resets. */
    hang();
}

void timer0_interrupt(void)
{
    TIMER_CLEAR(TIMER0) = 1u;
    image_current_interrupt(&image);
    if (HANG == 3 && sampled == RUN_PERIODS) {
        TIMER_CONTROL(TIMER0) = 0u;
    }
    if (HANG == 0 && sampled == 2u * RUN_PERIODS) {
        done = 1u;
    }
}

void timer1_interrupt(void)
{
    TIMER_CLEAR(TIMER1) = 1u;
    image_reference_interrupt(&image);
}

int main(void)
{
    if (left_by_alarm == SAYS_ALARM) {
        image_safe_state();
        printf("reset by the watchdog: closed %d cap %d sampled %lu\n", closed > 0.5f, cut > 0.5f, (unsigned long)sampled);
        return 0;
    }
    image_init(&image);
    an386_start_watchdog(WATCHDOG_TICKS);
    an386_start(TIMER0, TIMER0_NUMBER, PRIORITY_CURRENTS, PERIOD_TICKS);
    an386_start(TIMER1, TIMER1_NUMBER, PRIORITY_REFERENCES, PERIOD_TICKS * IMAGE_PERIODS);
    while (!done) {
    }
    printf("no alarm in %lu periods: closed %d\n", (unsigned long)sampled, closed > 0.5f);
    return 0;
}
