model Hysteresis "a heater with a thermostat"
  parameter Real low(unit = "K") = 350.0;
  parameter Real high(unit = "K") = 360.0;
  parameter Real power(unit = "W") = 100.0;
  parameter Real capacity(unit = "J/K") = 50.0;
  parameter Real conductance(unit = "W/K") = 1.0;
  output Real temperature(unit = "K", start = 340.0, fixed = true);
  Boolean on(start = true);
equation
  on = temperature < low or (pre(on) and temperature < high);
  capacity*der(temperature) = (if on then power else 0.0) - conductance*(temperature - 293.15);
end Hysteresis;
