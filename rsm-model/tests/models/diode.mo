model Diode "a capacitor charged through a diode and a resistor: a nonlinear loop"
  parameter Real R(unit = "Ohm") = 10.0;
  parameter Real C(unit = "F") = 1e-4;
  parameter Real saturation(unit = "A") = 1e-9;
  parameter Real thermal(unit = "V") = 0.05;
  input Real u(unit = "V");
  Real v(unit = "V", start = 0.0, fixed = true);
  Real drop(unit = "V");
  output Real i(unit = "A");
equation
  i = saturation*(exp(drop/thermal) - 1);
  u = R*i + drop + v;
  C*der(v) = i;
end Diode;
