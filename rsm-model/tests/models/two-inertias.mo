
// BaseModelica — Mech_TwoInertias

model Mech_TwoInertias

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
  Real shaft.a.phi(unit = "rad", start = 0.0);
  Real shaft.a.tau(unit = "N.m", start = 0.0);
  Real shaft.b.phi(unit = "rad", start = 0.0);
  Real shaft.b.tau(unit = "N.m", start = 0.0);
  parameter Real shaft.c(unit = "N.m/rad", start = 0.0) = 300;
  parameter Real shaft.d(unit = "N.m.s/rad", start = 0.0) = 0.4;
  Real shaft.twist(unit = "rad", start = 0.0);
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
  shaft.twist = (shaft.b.phi - shaft.a.phi);
  shaft.b.tau = ((shaft.c * shaft.twist) + (shaft.d * der(shaft.twist)));
  (shaft.a.tau + shaft.b.tau) = 0;
  source.b.tau = (-source.tau);
  speed = load.w;
  0 = (source.b.tau + motor.a.tau);
  0 = (motor.b.tau + shaft.a.tau);
  0 = (shaft.b.tau + load.a.tau);
  source.b.phi = motor.a.phi;
  motor.b.phi = shaft.a.phi;
  shaft.b.phi = load.a.phi;
  0 = load.b.tau;

end Mech_TwoInertias;

