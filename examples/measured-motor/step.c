/* The currents by surfaces: limit the torque, see how far the speed is beyond the base speed of this torque, ask two surfaces.
 *
 * A voltage other than the one of the fit is another speed: multiply the speed by the voltage of the fit over the voltage. NaN in gives NaN out.
 */
#include "step.h"

/* The evaluators as source: the compiler shares what they have in common, and saves nothing around calls. */
#include "currents.c"
#include "exact.h"

EXACT_FLATTEN current step_currents(float torque, float speed)
{
    const float magnitude = exact_magnitude(speed);
    const float limit = currents_limit_torque_f32(magnitude);
    const float limited = exact_within(torque, -limit, limit);
    const float beyond = magnitude - currents_base_speed_f32(limited);
    current i;
    i.i_d = currents_i_d_f32(limited, beyond);
    i.i_q = currents_i_q_f32(limited, beyond);
    return i;
}
