model TwoMassDrive "a motor turns a load through a shaft that twists"
  parameter Real motor_inertia(unit = "kg.m2", min = 0.0) = 0.002;
  parameter Real load_inertia(unit = "kg.m2", min = 0.0) = 0.006;
  parameter Real stiffness(unit = "N.m/rad", min = 0.0) = 14.0;
  parameter Real damping(unit = "N.m.s/rad", min = 0.0) = 0.02;
  parameter Real motor_friction(unit = "N.m.s/rad", min = 0.0) = 0.008;
  parameter Real load_friction(unit = "N.m.s/rad", min = 0.0) = 0.012;
  input Real torque(unit = "N.m");
  output Real motor_speed(unit = "rad/s", start = 0.0);
  output Real load_speed(unit = "rad/s", start = 0.0);
  output Real load_angle(unit = "rad", start = 0.0);
  Real motor_angle(unit = "rad");
  Real twist(unit = "rad", start = 0.0);
  Real twist_rate(unit = "rad/s");
  Real shaft_torque(unit = "N.m");
equation
  motor_angle = load_angle + twist;
  twist_rate = motor_speed - load_speed;
  shaft_torque = stiffness*twist + damping*twist_rate;
  der(twist) = twist_rate;
  der(load_angle) = load_speed;
  motor_inertia*der(motor_speed) = torque - motor_friction*motor_speed - shaft_torque;
  load_inertia*der(load_speed) = shaft_torque - load_friction*load_speed;
end TwoMassDrive;
