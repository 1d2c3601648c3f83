// Equations of docs/book/src/reference/plants.md, section 2.1, numbers (17), (18), (21) of the paper there.
model Pmac "surface permanent-magnet AC motor in the rotor frame"
  parameter Real phase_resistance(unit = "Ohm", min = 0.0) = 0.08;
  parameter Real phase_inductance(unit = "H", min = 0.0) = 9e-4;
  parameter Real flux_linkage(unit = "V.s", min = 0.0) = 0.06;
  parameter Real pole_pairs(unit = "1", min = 1.0) = 4;
  parameter Real inertia(unit = "kg.m2", min = 0.0) = 0.0015;
  parameter Real viscous_friction(unit = "N.m.s/rad", min = 0.0) = 0.0008;
  parameter Real bus_voltage(unit = "V", min = 0.0) = 270.0 "binds whoever makes a record, not the equations";
  parameter Real current_limit(unit = "A", min = 0.0) = 60.0 "binds whoever makes a record, not the equations";
  parameter Boolean holds_i_d = false "the record has no direct quantities: a drive that holds i_d = 0";
  input Real v_d(unit = "V") "voltage, direct axis";
  input Real v_q(unit = "V") "voltage, quadrature axis";
  input Real load_torque(unit = "N.m");
  output Real i_d(unit = "A", start = 0.0) "current, direct axis";
  output Real i_q(unit = "A", start = 0.0) "current, quadrature axis";
  output Real speed(unit = "rad/s", start = 0.0) "of the rotor";
  Real angle(unit = "rad", start = 0.0) "of the rotor";
  Real electrical_speed(unit = "rad/s");
  Real torque(unit = "N.m") "of the currents";
equation
  electrical_speed = pole_pairs*speed;
  phase_inductance*der(i_d) = if holds_i_d then 0.0 else v_d - phase_resistance*i_d + electrical_speed*phase_inductance*i_q;
  phase_inductance*der(i_q) = v_q - phase_resistance*i_q - electrical_speed*(phase_inductance*i_d + flux_linkage);
  torque = 1.5*pole_pairs*flux_linkage*i_q;
  inertia*der(speed) = torque - viscous_friction*speed - load_torque;
  der(angle) = speed;
end Pmac;
