model GearMotor "DC motor with a rigid gearbox; speed and load at the output shaft"
  parameter Real resistance(unit = "Ohm", min = 0.0) = 1.2;
  parameter Real inductance(unit = "H", min = 0.0) = 0.004;
  parameter Real torque_constant(unit = "N.m/A", min = 0.0) = 0.05 "also the EMF per speed of the rotor";
  parameter Real rotor_inertia(unit = "kg.m2", min = 0.0) = 4e-5;
  parameter Real gear_ratio(unit = "1", min = 0.0) = 20.0;
  parameter Real load_inertia(unit = "kg.m2", min = 0.0) = 0.02;
  parameter Real viscous_friction(unit = "N.m.s/rad", min = 0.0) = 0.05 "at the output shaft";
  input Real voltage(unit = "V");
  input Real load(unit = "N.m") "resists forward motion of the output shaft";
  output Real current(unit = "A", start = 0.0);
  output Real speed(unit = "rad/s", start = 0.0);
  Real rotor_speed(unit = "rad/s");
  Real gear_torque(unit = "N.m") "at the output shaft";
  Real angle(unit = "rad", start = 0.0);
equation
  inductance*der(current) = voltage - resistance*current - torque_constant*rotor_speed;
  rotor_speed = gear_ratio*speed;
  rotor_inertia*der(rotor_speed) = torque_constant*current - gear_torque/gear_ratio;
  load_inertia*der(speed) = gear_torque - viscous_friction*speed - load;
  der(angle) = speed;
end GearMotor;
