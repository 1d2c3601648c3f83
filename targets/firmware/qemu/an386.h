/* The registers of the board MPS2 with image AN386 that the firmware uses: timers, watchdog, interrupt controller, floating-point context.
 *
 * Sources: Arm Cortex-M System Design Kit, technical reference manual, 4.2 (timer) and 4.4 (watchdog); Arm application note 386 (addresses, numbers of
 * interrupts); Armv7-M Architecture Reference Manual, B3.
 */
#ifndef AN386_H
#define AN386_H

#include <stdint.h>

#define AN386_REGISTER(address) (*(volatile uint32_t *)(address))

/* Timers count down from the reload value at 25 MHz. */
#define TIMER0 0x40000000u
#define TIMER1 0x40001000u
#define TIMER_CONTROL(timer) AN386_REGISTER((timer) + 0x00u)
#define TIMER_VALUE(timer) AN386_REGISTER((timer) + 0x04u)
#define TIMER_RELOAD(timer) AN386_REGISTER((timer) + 0x08u)
#define TIMER_CLEAR(timer) AN386_REGISTER((timer) + 0x0Cu)
#define TIMER_ENABLE 1u
#define TIMER_INTERRUPT 8u
#define TICKS_A_SECOND 25000000u
#define TIMER0_NUMBER 8u
#define TIMER1_NUMBER 9u

/* The watchdog: the first time that it gets to 0 it asks for the interrupt that cannot be masked, the second time it resets. */
#define WATCHDOG 0x40008000u
#define WATCHDOG_LOAD AN386_REGISTER(WATCHDOG + 0x000u)
#define WATCHDOG_CONTROL AN386_REGISTER(WATCHDOG + 0x008u)
#define WATCHDOG_CLEAR AN386_REGISTER(WATCHDOG + 0x00Cu)
#define WATCHDOG_LOCK AN386_REGISTER(WATCHDOG + 0xC00u)
#define WATCHDOG_KEY 0x1ACCE551u
#define WATCHDOG_INTERRUPT_AND_RESET 3u

/* Nested vectored interrupt controller: enable, priority (a byte an interrupt, the smaller the more urgent). */
#define NVIC_ENABLE AN386_REGISTER(0xE000E100u)
#define NVIC_PENDING AN386_REGISTER(0xE000E200u)
#define NVIC_PRIORITY(number) (*(volatile uint8_t *)(0xE000E400u + (number)))
#define PRIORITY_CURRENTS 0x40u
#define PRIORITY_REFERENCES 0x80u

/* Floating-point context control: an interrupt leaves room for s0 to s15 and FPSCR (ASPEN), and fills it only when it uses the FPU itself (LSPEN). */
#define FPCCR AN386_REGISTER(0xE000EF34u)
#define FPCCR_ASPEN_LSPEN 0xC0000000u

/* Starts a timer with so many ticks a period. */
static inline void an386_start(uint32_t timer, uint32_t number, uint8_t priority, uint32_t ticks)
{
    TIMER_CONTROL(timer) = 0u;
    TIMER_RELOAD(timer) = ticks - 1u;
    TIMER_VALUE(timer) = ticks - 1u;
    TIMER_CLEAR(timer) = 1u;
    NVIC_PRIORITY(number) = priority;
    NVIC_ENABLE = 1u << number;
    TIMER_CONTROL(timer) = TIMER_ENABLE | TIMER_INTERRUPT;
}

static inline void an386_start_watchdog(uint32_t ticks)
{
    WATCHDOG_LOCK = WATCHDOG_KEY;
    WATCHDOG_LOAD = ticks;
    WATCHDOG_CONTROL = WATCHDOG_INTERRUPT_AND_RESET;
    WATCHDOG_LOCK = 0u;
}

/* Begins the count again. */
static inline void an386_feed_watchdog(void)
{
    WATCHDOG_LOCK = WATCHDOG_KEY;
    WATCHDOG_CLEAR = 1u;
    WATCHDOG_LOCK = 0u;
}

#endif
