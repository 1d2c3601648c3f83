/* The constants of the two loops: one table each. Written by tests/all/firmware (RSM_BLESS=1) from what the Rust steps use. */
#ifndef TABLES_H
#define TABLES_H

#include "motor_step.h"
#include "throttle_step.h"

/* The motor of rsm-sim/plants/pmac.toml at 10 kHz. */
extern const motor_drive tables_drive;

/* Everything between the converters and the throttle's step: a board with other sensors has another table. */
extern const throttle_scaling tables_scaling;

#endif
