
// BaseModelica — More_Thermal "a rod of four nodes, heated at one end"

model More_Thermal "a rod of four nodes, heated at one end"

  // --- variable declarations ---
  parameter Integer n(start = 4) = 4;
  parameter Real capacity(unit = "J/K", start = 100) = 100;
  parameter Real conductance(unit = "W/K", start = 2) = 2;
  parameter Real ambient(unit = "K", start = 293.15) = 293.15;
  input Real heat(unit = "W", start = 0.0);
  Real[4] T(unit = "K", start = 293.15, fixed = true);
  output Real hot(unit = "K", start = 0.0);

equation
  // --- continuous equations ---
  (capacity * der(T[1])) = (heat - (conductance * (T[1] - T[2])));
  (capacity * der(T[2])) = ((conductance * (T[1] - T[2])) - (conductance * (T[2] - T[3])));
  (capacity * der(T[3])) = ((conductance * (T[2] - T[3])) - (conductance * (T[3] - T[4])));
  (capacity * der(T[n])) = ((conductance * (T[(n - 1)] - T[n])) - (conductance * (T[n] - ambient)));
  hot = T[1];

end More_Thermal;

