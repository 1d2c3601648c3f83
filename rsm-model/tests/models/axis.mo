model Axis "driven linear axis"
  parameter Real mass(unit = "kg", min = 0.0) = 95.1;
  parameter Real force_gain(unit = "N/V") = 35.15;
  parameter Real viscous_friction(unit = "N.s/m") = 203.5;
  input Real command(unit = "V");
  output Real position(unit = "m", start = 0.0);
  Real speed(unit = "m/s", start = 0.0);
equation
  mass*der(speed) = force_gain*command - viscous_friction*speed;
  der(position) = speed;
end Axis;
