/* The motor's steps on what they are told, period by period: the closed loop is elsewhere.
 *
 * In, on standard input: a record a period, eleven words of 32 bits: 1 where the outer step is called, its demand (4 floats), what the inner step is told (6 floats).
 * Out, on standard output: four floats a period, the command of the bridge.
 */
#include <stdio.h>

#include "motor_step.h"
#include "tables.h"

int main(void)
{
    static motor_reference_state outer;
    static motor_current_state inner;
    uint32_t ticks;
    float words[10];
    motor_reference_init(&outer);
    motor_current_init(&inner);
    while (fread(&ticks, sizeof ticks, 1u, stdin) == 1u && fread(words, sizeof words, 1u, stdin) == 1u) {
        motor_demand demand;
        motor_measured measured;
        __builtin_memcpy(&demand, words, sizeof demand);
        __builtin_memcpy(&measured, words + 4, sizeof measured);
        if (ticks != 0u) {
            motor_references(&outer, &tables_drive, &demand);
        }
        motor_currents(&inner, &tables_drive, &outer.last, &measured);
        if (fwrite(&inner.last, sizeof inner.last, 1u, stdout) != 1u) {
            return 1;
        }
    }
    return 0;
}
