// Equations of docs/book/src/reference/plants.md, section 2.1, numbers (17), (18), (21) of the paper there.
// A minimum of 1e-60, the constant `small` of Modelica, excludes 0.
model Pmac "surface permanent-magnet AC motor in the rotor frame"
  parameter Real phase_resistance(unit = "Ohm", min = 0.0) = 0.08;
  parameter Real phase_inductance(unit = "H", min = 1e-60) = 9e-4;
  parameter Real flux_linkage(unit = "Wb", min = 1e-60) = 0.06;
  parameter Integer pole_pairs(unit = "1", min = 1) = 4;
  parameter Real inertia(unit = "kg.m2", min = 1e-60) = 0.0015;
  parameter Real viscous_friction(unit = "N.m.s/rad", min = 0.0) = 0.0008;
  parameter Real bus_voltage(unit = "V", min = 1e-60) = 270.0 "binds whoever makes a record, not the equations";
  parameter Real current_limit(unit = "A", min = 1e-60) = 60.0 "binds whoever makes a record, not the equations";
  parameter Boolean holds_i_d = false "the record has no direct quantities: a drive that holds i_d = 0";
  input Real v_d(unit = "V") "voltage, direct axis";
  input Real v_q(unit = "V") "voltage, quadrature axis";
  input Real load_torque(unit = "N.m");
  output Real i_d(unit = "A", start = 0.0) "current, direct axis";
  output Real i_q(unit = "A", start = 0.0) "current, quadrature axis";
  output Real speed(unit = "rad/s", start = 0.0) "of the rotor";
  Real angle(unit = "rad", start = 0.0) "of the rotor";
  Real current_d(unit = "A", start = 0.0) "as it flows; i_d is what is read of it";
  Real current_q(unit = "A", start = 0.0) "as it flows; i_q is what is read of it";
  Real voltage_d(unit = "V") "as commanded";
  Real voltage_q(unit = "V") "as commanded";
  Real holding_d(unit = "V") "what the drive adds to hold i_d";
  Real holding_q(unit = "V") "what the drive adds to hold i_d";
  Real electrical_speed(unit = "rad/s");
  Real torque(unit = "N.m") "of the currents";
equation
  i_d = current_d;
  i_q = current_q;
  voltage_d = if holds_i_d then 0.0 else v_d;
  voltage_q = v_q;
  if holds_i_d then
    i_d = 0.0;
  else
    holding_d = 0.0;
  end if;
  holding_q = 0.0;
  electrical_speed = pole_pairs*speed;
  phase_inductance*der(current_d) = voltage_d + holding_d - phase_resistance*current_d + electrical_speed*phase_inductance*current_q;
  phase_inductance*der(current_q) = voltage_q + holding_q - phase_resistance*current_q - electrical_speed*(phase_inductance*current_d + flux_linkage);
  torque = 1.5*pole_pairs*flux_linkage*current_q;
  inertia*der(speed) = torque - viscous_friction*speed - load_torque;
  der(angle) = speed;
end Pmac;
