model Pendulum "a point mass on a rod, in Cartesian coordinates: index three"
  parameter Real m(unit = "kg") = 1.5;
  parameter Real length(unit = "m") = 0.8;
  parameter Real g(unit = "m/s2") = 9.81;
  output Real x(unit = "m", start = 0.2);
  output Real y(unit = "m", start = -0.7745966692414834);
  Real vx(unit = "m/s", start = 0.0);
  Real vy(unit = "m/s", start = 0.0);
  Real force(unit = "N/m");
equation
  der(x) = vx;
  der(y) = vy;
  m*der(vx) = -force*x;
  m*der(vy) = -force*y - m*g;
  x^2 + y^2 = length^2;
end Pendulum;
