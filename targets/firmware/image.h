/* Both loops as the interrupts of one program: the currents at 10 kHz, above references and throttle at 1 kHz.
 *
 * In: samples and demands, which the board reads. Out: commands, which the board obeys; the watchdog is fed while both interrupts run. The loops share no
 * variable but what is handed over. The board's own file has the registers: timers, priorities, converters, gate; qemu/an386.h is one.
 */
#ifndef IMAGE_H
#define IMAGE_H

#include "handover.h"
#include "motor_step.h"
#include "throttle_step.h"

/* What the outer step wants to know of the inner one's samples, taken together. */
typedef struct {
    float speed_rad_s;
    float bus_voltage_v;
    float voltage_share;
} image_seen;

HANDOVER(image_references, motor_reference)
HANDOVER(image_sight, image_seen)

typedef struct {
    /* Of the interrupt of the currents. */
    motor_current_state currents;
    /* Of the interrupt of the references. */
    motor_reference_state references;
    throttle_raw_state throttle;
    uint32_t periods_before;
    /* Between them. */
    image_references reference;
    image_sight sight;
    volatile uint32_t periods;
} image_state;

/* Periods of the currents between two calls of the references. */
#define IMAGE_PERIODS 10u

/* What a board has to have. Samples of the motor at the centre of the PWM's period; the command acts from the next period on. */
void board_sample(motor_measured *measured);
void board_command(const motor_command *command);
float board_torque_demand(void);
void board_counts(throttle_counts *counts);
/* The compare value of the throttle's PWM; cap is 0 where the drive of the plate is to be cut. */
void board_throttle(uint16_t compare, float cap);
void board_feed_watchdog(void);

/* Everything at rest, the bridge open. */
void image_init(image_state *image);

/* Every 0.1 ms, with the higher priority. */
void image_current_interrupt(image_state *image);

/* Every millisecond, with the lower priority. Feeds the watchdog if the currents were controlled in the meantime: at least half of the periods. */
void image_reference_interrupt(image_state *image);

/* The safe state, for the watchdog's first alarm, for faults, and for a start that follows a watchdog's reset: the bridge open, the plate's drive cut. */
void image_safe_state(void);

#endif
