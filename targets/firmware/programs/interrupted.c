/* The interrupt of the references, interrupted by that of the currents at every instruction.
 *
 * In each trial the same state is put back, a timer is set one tick later than in the trial before, and the outer interrupt runs. Whatever the instant, the inner
 * interrupt must see the references of before or those of after, the outer one the samples of before or those of after, and both must give the bits that they
 * give undisturbed. Under `-icount shift=6` an instruction takes 64 ns and a tick 40 ns, so no instruction is passed over.
 *
 * Out: a line "at ADDRESS" for every address at which the outer interrupt was interrupted, then the counts, the floating-point context, and bytes of stack.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "an386.h"
#include "image.h"

/* Trials without a hit before the end is believed, and the largest address of the code. */
#define QUIET 64u
#define CODE 0x40000u

static image_state image, start;
static motor_measured sample;
static uint32_t hits, torn, wrong, before, after, extended;
static uint8_t marked[CODE / 2u];
static motor_reference allowed[2];
static image_seen seen;
static float torque_nm = 9.0f;

void board_sample(motor_measured *measured)
{
    *measured = sample;
}

void board_command(const motor_command *command)
{
    (void)command;
}

float board_torque_demand(void)
{
    return torque_nm;
}

void board_counts(throttle_counts *counts)
{
    counts->pedal = 2000u;
    counts->plate = 1000u;
    counts->speed = 800u;
    counts->lines = 2u;
}

void board_throttle(uint16_t compare, float cap)
{
    (void)compare;
    (void)cap;
}

void board_feed_watchdog(void)
{
}

/* Angle and currents where the inner step expects them. */
static void as_expected(const motor_current_state *currents)
{
    const float angle = 6.2831853f * currents->angle_turns, d = currents->expected_d_a, q = currents->expected_q_a;
    sample.angle_turns = currents->angle_turns;
    for (uint32_t k = 0u; k < 3u; k++) {
        const float phase = angle - 2.0943951f * (float)k;
        sample.currents_a[k] = d * cosf(phase) - q * sinf(phase);
    }
}

static int is_same(const void *left, const void *right, size_t size)
{
    return memcmp(left, right, size) == 0;
}

/* The references that the inner interrupt of a trial took, and the inner state that must follow from either. */
static motor_current_state inner_after[2];

void interrupted_at(const uint32_t *frame, uint32_t exc_return);

void interrupted_at(const uint32_t *frame, uint32_t exc_return)
{
    const motor_reference taken = image_references_take(&image.reference);
    uint32_t address = frame[6];
    TIMER_CONTROL(TIMER0) = 0u;
    TIMER_CLEAR(TIMER0) = 1u;
    image_current_interrupt(&image);
    hits++;
    if (is_same(&taken, &allowed[0], sizeof taken)) {
        before++;
        wrong += !is_same(&image.currents, &inner_after[0], sizeof image.currents);
    } else if (is_same(&taken, &allowed[1], sizeof taken)) {
        after++;
        wrong += !is_same(&image.currents, &inner_after[1], sizeof image.currents);
    } else {
        torn++;
    }
    if (address < CODE) {
        marked[address / 2u] = 1u;
    }
    /* Armv7-M, B1.5.8: bit 4 is 0 where room for the floating-point registers was left. */
    extended += (exc_return & 0x10u) == 0u;
}

__attribute__((naked)) void timer0_interrupt(void)
{
    __asm__ volatile("mov r0, sp\n\tmov r1, lr\n\tb interrupted_at");
}

static motor_reference_state outer_after[2];
static throttle_raw_state throttle_after;

/* The stack below main, painted, and the bytes of it that lost their paint. */
#define PAINT 0xA5A5A5A5u
#define PAINTED_WORDS 1024u

static uint32_t *top;

static void paint(void)
{
    uint32_t k;
    /* A little below this function's own words. */
    top = (uint32_t *)__builtin_frame_address(0) - 8;
    for (k = 1u; k <= PAINTED_WORDS; k++) {
        *(volatile uint32_t *)(top - k) = PAINT;
    }
}

static uint32_t used(void)
{
    uint32_t unused = 0u;
    while (unused < PAINTED_WORDS && *(volatile uint32_t *)(top - PAINTED_WORDS + unused) == PAINT) {
        unused++;
    }
    return 4u * (PAINTED_WORDS + 8u - unused);
}

static uint32_t trials;

static void interrupt_everywhere(void)
{
    uint32_t ticks, quiet = 0u;
    for (ticks = 1u; quiet < QUIET; ticks++) {
        const uint32_t hits_before = hits;
        image = start;
        TIMER_RELOAD(TIMER0) = ticks;
        TIMER_VALUE(TIMER0) = ticks;
        TIMER_CONTROL(TIMER0) = TIMER_ENABLE | TIMER_INTERRUPT;
        /* Room for the first ticks, so that the first instruction of what follows is among the instants. */
        __asm__ volatile("nop\n\tnop\n\tnop\n\tnop" : : : "memory");
        image_reference_interrupt(&image);
        TIMER_CONTROL(TIMER0) = 0u;
        TIMER_CLEAR(TIMER0) = 1u;
        trials++;
        quiet = hits == hits_before ? quiet + 1u : 0u;
        wrong += !is_same(&image.references, &outer_after[0], sizeof image.references)
            && !is_same(&image.references, &outer_after[1], sizeof image.references);
        wrong += !is_same(&image.throttle, &throttle_after, sizeof image.throttle);
    }
}

int main(void)
{
    uint32_t k, stack;
    image_init(&start);
    sample.bus_voltage_v = 270.0f;
    sample.speed_rad_s = 600.0f;
    for (k = 0u; k < 40u; k++) {
        as_expected(&start.currents);
        image = start;
        image_current_interrupt(&image);
        if (k % IMAGE_PERIODS == IMAGE_PERIODS - 1u) {
            image_reference_interrupt(&image);
        }
        start = image;
    }
    /* Samples and a demand that move all that is handed over. */
    as_expected(&start.currents);
    sample.bus_voltage_v = 281.0f;
    sample.speed_rad_s = 620.0f;
    torque_nm = -4.0f;
    seen = image_sight_take(&start.sight);
    /* What the outer interrupt gives undisturbed, from the samples of before and from those of after. */
    allowed[0] = image_references_take(&start.reference);
    image = start;
    image_reference_interrupt(&image);
    outer_after[0] = image.references;
    throttle_after = image.throttle;
    allowed[1] = image_references_take(&image.reference);
    image_current_interrupt(&image);
    inner_after[1] = image.currents;
    image = start;
    image_current_interrupt(&image);
    inner_after[0] = image.currents;
    {
        const image_seen later = image_sight_take(&image.sight);
        printf("handed over: %d %d %d %d %d\n", seen.speed_rad_s != later.speed_rad_s, seen.bus_voltage_v != later.bus_voltage_v,
               seen.voltage_share != later.voltage_share, allowed[0].i_d_a != allowed[1].i_d_a, allowed[0].i_q_a != allowed[1].i_q_a);
    }
    image_reference_interrupt(&image);
    outer_after[1] = image.references;
    NVIC_PRIORITY(TIMER0_NUMBER) = PRIORITY_CURRENTS;
    NVIC_ENABLE = 1u << TIMER0_NUMBER;

    paint();
    /* Without and with a watchdog to be fed. */
    start.periods_before = start.periods;
    interrupt_everywhere();
    start.periods_before = start.periods - IMAGE_PERIODS;
    interrupt_everywhere();
    stack = used();
    for (k = 0u; k < CODE / 2u; k++) {
        if (marked[k]) {
            printf("at %lx\n", (unsigned long)(2u * k));
        }
    }
    printf("trials %lu hits %lu before %lu after %lu torn %lu wrong %lu extended %lu fpccr %08lx stack %lu\n", (unsigned long)trials, (unsigned long)hits,
           (unsigned long)before, (unsigned long)after, (unsigned long)torn, (unsigned long)wrong, (unsigned long)extended,
           (unsigned long)FPCCR, (unsigned long)stack);
    return 0;
}
