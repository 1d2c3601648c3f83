
// BaseModelica — More_Pitch "the pitch axis of a quadrotor with rotors that lag"

model More_Pitch "the pitch axis of a quadrotor with rotors that lag"

  // --- variable declarations ---
  parameter Real mass(unit = "kg", start = 1.2) = 1.2;
  parameter Real inertia(unit = "kg.m2", start = 0.015) = 0.015;
  parameter Real arm(unit = "m", start = 0.2) = 0.2;
  parameter Real g(unit = "m/s2", start = 9.80665) = 9.80665;
  parameter Real lag(unit = "s", start = 0.04) = 0.04;
  parameter Real drag(unit = "kg/m", start = 0.1) = 0.1;
  input Real front(unit = "N", start = 0.0);
  input Real rear(unit = "N", start = 0.0);
  Real f(unit = "N", start = 5.88399, fixed = true);
  Real r(unit = "N", start = 5.88399, fixed = true);
  output Real pitch(unit = "rad", start = 0.05, fixed = true);
  Real rate(unit = "rad/s", start = 0, fixed = true);
  output Real x(unit = "m", start = 0, fixed = true);
  Real vx(unit = "m/s", start = 0, fixed = true);
  Real vz(unit = "m/s", start = 0, fixed = true);

equation
  // --- continuous equations ---
  (lag * der(f)) = (front - f);
  (lag * der(r)) = (rear - r);
  der(pitch) = rate;
  (inertia * der(rate)) = (arm * (f - r));
  der(x) = vx;
  (mass * der(vx)) = (((f + r) * sin(pitch)) - ((drag * vx) * sqrt(((vx ^ 2) + (vz ^ 2)))));
  (mass * der(vz)) = ((((f + r) * cos(pitch)) - (mass * g)) - ((drag * vz) * sqrt(((vx ^ 2) + (vz ^ 2)))));

end More_Pitch;

