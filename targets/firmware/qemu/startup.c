/* Reset of a Cortex-M4F: FPU on, data copied, bss cleared, main called; and the vectors. For the emulated board; a vendor's startup file does the same on a real one. */
#include <stdint.h>
#include <stdlib.h>

extern uint32_t data_load[], data_start[], data_end[], bss_start[], bss_end[], stack_top[];

int main(void);
void initialise_monitor_handles(void);
void reset(void);
void trap(void);

/* CPACR, Armv7-M Architecture Reference Manual, B3.2.20: full access to coprocessors 10 and 11, which are the FPU. */
#define CPACR (*(volatile uint32_t *)0xE000ED88u)

void reset(void)
{
    const uint32_t *from = data_load;
    uint32_t *to;
    CPACR |= 0xFu << 20;
    __asm__ volatile("dsb\n\tisb");
    for (to = data_start; to < data_end; to++) {
        *to = *from++;
    }
    for (to = bss_start; to < bss_end; to++) {
        *to = 0u;
    }
    initialise_monitor_handles();
    exit(main());
}

/* A fault ends the run with a status that no program here returns. */
void trap(void)
{
    exit(77);
}

/* A program may have these; else they are faults. */
void watchdog_alarm(void) __attribute__((weak, alias("trap")));
void timer0_interrupt(void) __attribute__((weak, alias("trap")));
void timer1_interrupt(void) __attribute__((weak, alias("trap")));

__attribute__((section(".vectors"), used)) static const uintptr_t vectors[16 + 10] = {
    (uintptr_t)stack_top, (uintptr_t)reset, (uintptr_t)watchdog_alarm, (uintptr_t)trap,
    (uintptr_t)trap,      (uintptr_t)trap,  (uintptr_t)trap,           0,
    0,                    0,                0,                         (uintptr_t)trap,
    (uintptr_t)trap,      0,                (uintptr_t)trap,           (uintptr_t)trap,
    /* Interrupts 0 to 9 of the board: 8 and 9 are the timers. */
    (uintptr_t)trap,      (uintptr_t)trap,  (uintptr_t)trap,           (uintptr_t)trap,
    (uintptr_t)trap,      (uintptr_t)trap,  (uintptr_t)trap,           (uintptr_t)trap,
    (uintptr_t)timer0_interrupt, (uintptr_t)timer1_interrupt,
};
