
// BaseModelica — Mech_GearTrain

model Mech_GearTrain

  // --- variable declarations ---
  input Real torque(unit = "N.m", start = 0.0);
  output Real speed(unit = "rad/s", start = 0.0);
  Real motor.a.phi(unit = "rad", start = 0.0);
  Real motor.a.tau(unit = "N.m", start = 0.0);
  Real motor.b.phi(unit = "rad", start = 0.0);
  Real motor.b.tau(unit = "N.m", start = 0.0);
  parameter Real motor.J(unit = "kg.m2", min = 0, start = 0.0) = 0.1 "inertia";
  Real motor.phi(unit = "rad", start = 0, fixed = true);
  Real motor.w(unit = "rad/s", start = 0, fixed = true);
  Real load.a.phi(unit = "rad", start = 0.0);
  Real load.a.tau(unit = "N.m", start = 0.0);
  Real load.b.phi(unit = "rad", start = 0.0);
  Real load.b.tau(unit = "N.m", start = 0.0);
  parameter Real load.J(unit = "kg.m2", min = 0, start = 0.0) = 2.0 "inertia";
  Real load.phi(unit = "rad", start = 0, fixed = true);
  Real load.w(unit = "rad/s", start = 0, fixed = true);
  Real gear.a.phi(unit = "rad", start = 0.0);
  Real gear.a.tau(unit = "N.m", start = 0.0);
  Real gear.b.phi(unit = "rad", start = 0.0);
  Real gear.b.tau(unit = "N.m", start = 0.0);
  parameter Real gear.ratio(start = 0.0) = 7;
  Real source.b.phi(unit = "rad", start = 0.0);
  Real source.b.tau(unit = "N.m", start = 0.0);
  input Real source.tau(unit = "N.m", start = 0.0) = torque;

equation
  // --- continuous equations ---
  motor.phi = motor.a.phi;
  motor.phi = motor.b.phi;
  motor.w = der(motor.phi);
  (motor.J * der(motor.w)) = (motor.a.tau + motor.b.tau);
  load.phi = load.a.phi;
  load.phi = load.b.phi;
  load.w = der(load.phi);
  (load.J * der(load.w)) = (load.a.tau + load.b.tau);
  gear.a.phi = (gear.ratio * gear.b.phi);
  0 = ((gear.ratio * gear.a.tau) + gear.b.tau);
  source.b.tau = (-source.tau);
  speed = load.w;
  0 = (source.b.tau + motor.a.tau);
  0 = (motor.b.tau + gear.a.tau);
  0 = (gear.b.tau + load.a.tau);
  source.b.phi = motor.a.phi;
  motor.b.phi = gear.a.phi;
  gear.b.phi = load.a.phi;
  0 = load.b.tau;

end Mech_GearTrain;

