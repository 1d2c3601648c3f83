model First
  parameter Real tau(unit = "s") = 0.5;
  input Real u(unit = "V");
  output Real y(unit = "V");
equation
  tau*der(y) = u - y;
end First;
