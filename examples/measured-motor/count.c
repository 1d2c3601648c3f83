/* Instructions of each controller on an emulated Cortex-M4F under `-icount shift=6`, a line each: NAME MEAN LEAST MOST.
 *
 * Over a grid of torque and speed, the call included. An instruction takes 64 ns of the emulated time, and the timer of the board ticks every 40 ns. These are
 * instructions, not cycles.
 */
#include <stdint.h>
#include <stdio.h>

#include "optimum.h"
#include "step.h"

/* CMSDK APB timer 0, counts down. */
#define TIMER_CONTROL (*(volatile uint32_t *)0x40000000u)
#define TIMER_VALUE (*(volatile uint32_t *)0x40000004u)
#define TIMER_RELOAD (*(volatile uint32_t *)0x40000008u)
/* So many calls that a tick of the timer is a hundredth of an instruction a call. */
#define CALLS 100u
#define ROWS 15
#define COLUMNS 16

static float torque, speed;
static volatile float sink;

static void take(current i)
{
    sink = i.i_d + i.i_q;
}

static void call_solver(void)
{
    take(optimum_currents(torque, speed).i);
}

static void call_table(void)
{
    take(table_currents(torque, speed));
}

static void call_surface(void)
{
    take(step_currents(torque, speed));
}

/* The same call with the shortest controller there can be. */
static __attribute__((noinline)) current nothing(float asked, float at)
{
    current i;
    i.i_d = asked;
    i.i_q = at;
    __asm__ volatile("" : : : "memory");
    return i;
}

static void call_nothing(void)
{
    take(nothing(torque, speed));
}

static uint32_t instructions_of(void (*volatile call)(void))
{
    uint32_t k, before, ticks;
    TIMER_CONTROL = 0u;
    TIMER_RELOAD = 0xFFFFFFFFu;
    TIMER_VALUE = 0xFFFFFFFFu;
    TIMER_CONTROL = 1u;
    before = TIMER_VALUE;
    for (k = 0u; k < CALLS; k++) {
        call();
    }
    ticks = before - TIMER_VALUE;
    return (ticks * 40u / 64u + CALLS / 2u) / CALLS;
}

static void print(const char *name, void (*call)(void))
{
    uint32_t least = 0xFFFFFFFFu, most = 0u, sum = 0u;
    int row, column;
    for (row = 0; row < ROWS; row++) {
        for (column = 0; column < COLUMNS; column++) {
            uint32_t found;
            torque = (float)TOP_TORQUE * ((float)column + 0.5f) / (float)COLUMNS;
            speed = (float)TOP_SPEED * ((float)row + 0.5f) / (float)ROWS;
            /* Without the frame of the loop and of the call; the controller's own return counts. */
            found = instructions_of(call) - instructions_of(call_nothing) + 1u;
            least = found < least ? found : least;
            most = found > most ? found : most;
            sum += found;
        }
    }
    printf("%s %lu %lu %lu\n", name, (unsigned long)((sum + ROWS * COLUMNS / 2) / (ROWS * COLUMNS)), (unsigned long)least, (unsigned long)most);
}

int main(void)
{
    print("solver", call_solver);
    print("table", call_table);
    print("surface", call_surface);
    return 0;
}
