/* See image.h. */
#include "image.h"

#include "tables.h"

void image_init(image_state *image)
{
    static const image_seen nothing = {0.0f, 0.0f, 0.0f};
    motor_current_init(&image->currents);
    motor_reference_init(&image->references);
    throttle_raw_init(&image->throttle);
    image->periods_before = 0u;
    image->periods = 0u;
    image->reference.newest = 0u;
    image->reference.slots[0] = image->references.last;
    image->sight.newest = 0u;
    image->sight.slots[0] = nothing;
}

void image_current_interrupt(image_state *image)
{
    const motor_reference reference = image_references_take(&image->reference);
    motor_measured measured;
    image_seen seen;
    board_sample(&measured);
    motor_currents(&image->currents, &tables_drive, &reference, &measured);
    board_command(&image->currents.last);
    /* As measured: the outer step judges for itself. */
    seen.speed_rad_s = measured.speed_rad_s;
    seen.bus_voltage_v = measured.bus_voltage_v;
    seen.voltage_share = image->currents.voltage_share;
    image_sight_put(&image->sight, &seen);
    image->periods = image->periods + 1u;
}

void image_reference_interrupt(image_state *image)
{
    const image_seen seen = image_sight_take(&image->sight);
    const uint32_t periods = image->periods;
    throttle_counts counts;
    motor_demand demand;
    uint16_t compare;
    demand.torque_nm = board_torque_demand();
    demand.speed_rad_s = seen.speed_rad_s;
    demand.bus_voltage_v = seen.bus_voltage_v;
    demand.voltage_share = seen.voltage_share;
    motor_references(&image->references, &tables_drive, &demand);
    image_references_put(&image->reference, &image->references.last);

    board_counts(&counts);
    compare = throttle_raw_step(&image->throttle, &tables_scaling, &counts);
    board_throttle(compare, image->throttle.step.cap);

    if (periods - image->periods_before >= IMAGE_PERIODS / 2u) {
        board_feed_watchdog();
    }
    image->periods_before = periods;
}

void image_safe_state(void)
{
    static const motor_command open = {{0.5f, 0.5f, 0.5f}, 0.0f};
    board_command(&open);
    board_throttle((uint16_t)(tables_scaling.compare_closed + 0.5f), 0.0f);
}
