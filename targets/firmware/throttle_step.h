/* The step of a drive-by-wire throttle that damps driveline shuffle: the twin of targets/throttle-loop in C, bit for bit.
 *
 * In, every millisecond: pedal, speed, gear, clutch; or raw A/D counts and gear lines. Out: the throttle, or a PWM compare value. Every struct is
 * explained in targets/throttle-loop/src. Never loops, branches or allocates.
 */
#ifndef THROTTLE_STEP_H
#define THROTTLE_STEP_H

#include "driveline.h"
#include "exact.h"

#define THROTTLE_GEARS 5u
#define THROTTLE_CLUTCH_LINE (1u << THROTTLE_GEARS)

typedef struct {
    float pedal;
    float speed_m_s;
    uint32_t gear;
    uint32_t clutch;
} throttle_inputs;

typedef struct {
    driveline_tip_in_state_f32 compensator;
    float pedal;
    float speed_m_s;
    float gear;
    float share;
    float lost;
    /* The throttle is never above this: less than 1 after a fault. */
    float cap;
    bad_samples bad;
} throttle_state;

typedef struct {
    float zero;
    float per_count;
    float lowest;
    float highest;
} throttle_channel;

typedef struct {
    throttle_channel pedal;
    throttle_channel plate;
    throttle_channel speed;
    float compare_closed;
    float compare_span;
} throttle_scaling;

typedef struct {
    uint16_t pedal;
    uint16_t plate;
    uint16_t speed;
    uint32_t lines;
} throttle_counts;

typedef struct {
    throttle_state step;
    float throttle;
    float closing;
    bad_samples plate;
} throttle_raw_state;

void throttle_init(throttle_state *state);
void throttle_raw_init(throttle_raw_state *state);

/* The throttle, 0 to 1; clutch is 0 or 1. */
float throttle_step(throttle_state *state, const throttle_inputs *inputs);

/* The compare value of the PWM. */
uint16_t throttle_raw_step(throttle_raw_state *state, const throttle_scaling *scaling, const throttle_counts *counts);

#endif
