
// BaseModelica — More_Rlc "source, divider with a load branch: an algebraic loop of resistors"

model More_Rlc "source, divider with a load branch: an algebraic loop of resistors"

  // --- variable declarations ---
  input Real voltage(unit = "V", start = 0.0);
  output Real current(unit = "A", start = 0.0);
  Real source.p.v(unit = "V", start = 0.0);
  Real source.p.i(unit = "A", start = 0.0);
  Real source.n.v(unit = "V", start = 0.0);
  Real source.n.i(unit = "A", start = 0.0);
  input Real source.u(unit = "V", start = 0.0) = voltage;
  Real ground.p.v(unit = "V", start = 0.0);
  Real ground.p.i(unit = "A", start = 0.0);
  Real r1.p.v(unit = "V", start = 0.0);
  Real r1.p.i(unit = "A", start = 0.0);
  Real r1.n.v(unit = "V", start = 0.0);
  Real r1.n.i(unit = "A", start = 0.0);
  parameter Real r1.R(unit = "Ohm", start = 0.0) = 10;
  Real r1.v(unit = "V", start = 0.0);
  Real r2.p.v(unit = "V", start = 0.0);
  Real r2.p.i(unit = "A", start = 0.0);
  Real r2.n.v(unit = "V", start = 0.0);
  Real r2.n.i(unit = "A", start = 0.0);
  parameter Real r2.R(unit = "Ohm", start = 0.0) = 20;
  Real r2.v(unit = "V", start = 0.0);
  Real r3.p.v(unit = "V", start = 0.0);
  Real r3.p.i(unit = "A", start = 0.0);
  Real r3.n.v(unit = "V", start = 0.0);
  Real r3.n.i(unit = "A", start = 0.0);
  parameter Real r3.R(unit = "Ohm", start = 0.0) = 5;
  Real r3.v(unit = "V", start = 0.0);
  Real l.p.v(unit = "V", start = 0.0);
  Real l.p.i(unit = "A", start = 0.0);
  Real l.n.v(unit = "V", start = 0.0);
  Real l.n.i(unit = "A", start = 0.0);
  parameter Real l.L(unit = "H", start = 0.0) = 0.1;
  Real l.i(unit = "A", start = 0, fixed = true);
  Real c.p.v(unit = "V", start = 0.0);
  Real c.p.i(unit = "A", start = 0.0);
  Real c.n.v(unit = "V", start = 0.0);
  Real c.n.i(unit = "A", start = 0.0);
  parameter Real c.C(unit = "F", start = 0.0) = 0.001;
  Real c.v(unit = "V", start = 0, fixed = true);

equation
  // --- continuous equations ---
  source.u = (source.p.v - source.n.v);
  (source.p.i + source.n.i) = 0;
  ground.p.v = 0;
  r1.v = (r1.p.v - r1.n.v);
  r1.v = (r1.R * r1.p.i);
  (r1.p.i + r1.n.i) = 0;
  r2.v = (r2.p.v - r2.n.v);
  r2.v = (r2.R * r2.p.i);
  (r2.p.i + r2.n.i) = 0;
  r3.v = (r3.p.v - r3.n.v);
  r3.v = (r3.R * r3.p.i);
  (r3.p.i + r3.n.i) = 0;
  (l.L * der(l.i)) = (l.p.v - l.n.v);
  l.i = l.p.i;
  (l.p.i + l.n.i) = 0;
  c.v = (c.p.v - c.n.v);
  (c.C * der(c.v)) = c.p.i;
  (c.p.i + c.n.i) = 0;
  current = r1.p.i;
  0 = (source.p.i + r1.p.i);
  0 = ((r1.n.i + r2.p.i) + r3.p.i);
  0 = (r3.n.i + l.p.i);
  0 = (l.n.i + c.p.i);
  0 = (((c.n.i + ground.p.i) + r2.n.i) + source.n.i);
  source.p.v = r1.p.v;
  r1.n.v = r2.p.v;
  r2.p.v = r3.p.v;
  r3.n.v = l.p.v;
  l.n.v = c.p.v;
  c.n.v = ground.p.v;
  ground.p.v = r2.n.v;
  r2.n.v = source.n.v;

end More_Rlc;

