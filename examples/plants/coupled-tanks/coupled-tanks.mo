model CoupledTanks "a pump fills the first tank, a pipe joins it with the second, which drains"
  constant Real g(unit = "m/s2") = 9.80665;
  constant Real calm(unit = "m") = 0.002 "below this difference of levels the flow in a pipe is linear";
  parameter Real area_1(unit = "m2", min = 0.0) = 0.02;
  parameter Real area_2(unit = "m2", min = 0.0) = 0.015;
  parameter Real pump_gain(unit = "m3/(s.V)", min = 0.0) = 3e-5;
  parameter Real pipe_area(unit = "m2", min = 0.0) = 9e-5 "between the tanks";
  parameter Real drain_area(unit = "m2", min = 0.0) = 7e-5;
  input Real pump(unit = "V") "0 to 10";
  output Real level_1(unit = "m", start = 0.2);
  output Real level_2(unit = "m", start = 0.1);
  Real difference(unit = "m");
  Real pipe_flow(unit = "m3/s");
  Real drain_flow(unit = "m3/s");
equation
  difference = level_1 - level_2;
  pipe_flow = pipe_area*sqrt(2*g)*difference/sqrt(sqrt(difference^2 + calm^2));
  drain_flow = drain_area*sqrt(2*g)*level_2/sqrt(sqrt(level_2^2 + calm^2));
  area_1*der(level_1) = pump_gain*pump - pipe_flow;
  area_2*der(level_2) = pipe_flow - drain_flow;
end CoupledTanks;
