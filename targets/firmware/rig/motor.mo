// The motor of rsm-sim/plants/pmac.toml behind its bridge, in the frame of the stator: duties in, what the sensors show out.
model RigMotor "permanent-magnet motor behind a bridge of three legs"
  constant Real pi = 3.141592653589793;
  parameter Real phase_resistance(unit = "Ohm") = 0.08;
  parameter Real phase_inductance(unit = "H") = 9e-4;
  parameter Real flux_linkage(unit = "V.s") = 0.06;
  parameter Real pole_pairs(unit = "1") = 4.0;
  parameter Real inertia(unit = "kg.m2") = 0.0015;
  parameter Real viscous_friction(unit = "N.m.s/rad") = 0.0008;
  parameter Real bus_voltage(unit = "V") = 270.0;
  input Real duty_a(unit = "1", min = 0.0, max = 1.0);
  input Real duty_b(unit = "1", min = 0.0, max = 1.0);
  input Real duty_c(unit = "1", min = 0.0, max = 1.0);
  output Real current_a(unit = "A");
  output Real current_b(unit = "A");
  output Real current_c(unit = "A");
  output Real turns(unit = "1") "electrical angle, 0 to 1";
  output Real speed(unit = "rad/s", start = 0.0);
  Real i_alpha(unit = "A", start = 0.0);
  Real i_beta(unit = "A", start = 0.0);
  Real angle(unit = "rad", start = 0.0) "electrical";
  Real torque(unit = "N.m");
equation
  phase_inductance*der(i_alpha) = bus_voltage*(2*duty_a - duty_b - duty_c)/3 - phase_resistance*i_alpha + pole_pairs*speed*flux_linkage*sin(angle);
  phase_inductance*der(i_beta) = bus_voltage*(duty_b - duty_c)/sqrt(3) - phase_resistance*i_beta - pole_pairs*speed*flux_linkage*cos(angle);
  torque = 1.5*pole_pairs*flux_linkage*(i_beta*cos(angle) - i_alpha*sin(angle));
  inertia*der(speed) = torque - viscous_friction*speed;
  der(angle) = pole_pairs*speed;
  current_a = i_alpha;
  current_b = sqrt(0.75)*i_beta - 0.5*i_alpha;
  current_c = -sqrt(0.75)*i_beta - 0.5*i_alpha;
  turns = mod(angle, 2*pi)/(2*pi);
end RigMotor;
