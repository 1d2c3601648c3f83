// Equations of docs/book/src/reference/plants.md, section 2.3. A minimum of 1e-60, the constant `small` of Modelica, excludes 0.
package ServoAxes
  model ServoAxisClosedLoop "driven linear axis under its position controller"
    parameter Real mass(unit = "kg", min = 1e-60) = 95.1089;
    parameter Real force_gain(unit = "N/V", min = 1e-60) = 35.15065188248547;
    parameter Real viscous_friction(unit = "N.s/m", min = 0.0) = 203.5034;
    parameter Real command_limit(unit = "V", min = 1e-60) = 10.0;
    parameter Real position_gain(unit = "1/s", min = 1e-60) = 160.18;
    parameter Real velocity_gain(unit = "V.s/m", min = 1e-60) = 243.45;
    parameter Boolean velocity_from_difference = false "backward difference of the mean of two samples, in place of the state";
    parameter Real record_period(unit = "s", min = 0.0) = 0.001 "the sample period of the record";
    parameter Real record_start(unit = "s") = 0.0 "the first instant of the record";
    input Real reference(unit = "m");
    output Real position(unit = "m", start = 0.0);
    output Real command(unit = "V", start = 0.0) "computed at the instants of the record and held";
    Real acting_command(unit = "V");
    Real speed(unit = "m/s", start = 0.0);
    discrete Real position_now(unit = "m", start = 0.0);
    discrete Real position_before(unit = "m", start = 0.0);
    discrete Real position_long_before(unit = "m", start = 0.0);
    discrete Real speed_seen(unit = "m/s", start = 0.0);
  initial equation
    // The drive came to its start at its start's speed.
    position_now = position - speed*record_period;
    position_before = position - 2*speed*record_period;
    position_long_before = position - 3*speed*record_period;
  equation
    acting_command = command;
    mass*der(speed) = force_gain*acting_command - viscous_friction*speed;
    der(position) = speed;
    when sample(record_start, record_period) then
      position_now = position;
      position_before = pre(position_now);
      position_long_before = pre(position_before);
      speed_seen = if velocity_from_difference then (position_now - position_long_before)/(2*record_period) else speed;
      command = max(-command_limit, min(command_limit, velocity_gain*(position_gain*(reference - position) - speed_seen)));
    end when;
  end ServoAxisClosedLoop;

  model ServoAxis "driven linear axis"
    parameter Real mass(unit = "kg", min = 1e-60) = 95.1089;
    parameter Real force_gain(unit = "N/V", min = 1e-60) = 35.15065188248547;
    parameter Real viscous_friction(unit = "N.s/m", min = 0.0) = 203.5034;
    parameter Real command_limit(unit = "V", min = 1e-60) = 10.0 "binds the controller, not the equations";
    input Real command(unit = "V");
    output Real position(unit = "m", start = 0.0);
    Real speed(unit = "m/s", start = 0.0);
  equation
    mass*der(speed) = force_gain*command - viscous_friction*speed;
    der(position) = speed;
  end ServoAxis;
end ServoAxes;
