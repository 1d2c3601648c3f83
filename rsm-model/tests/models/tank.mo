
// BaseModelica — More_Tank "a tank whose surplus leaves over its edge"

model More_Tank "a tank whose surplus leaves over its edge"

  // --- variable declarations ---
  input Real inflow(unit = "m3/s", start = 0.0);
  output Real level(unit = "m", start = 0.2, fixed = true);
  parameter Real area(unit = "m2", min = 0, start = 0.5) = 0.5;
  parameter Real edge(unit = "m", start = 1.0) = 1.0;
  parameter Real valve(unit = "m2/s", start = 0.02) = 0.02;
  parameter Real weir(unit = "m2/s", start = 3.0) = 3.0;
  Real outflow(unit = "m3/s", start = 0.0);
  Real overflow(unit = "m3/s", start = 0.0);

equation
  // --- continuous equations ---
  (area * der(level)) = ((inflow - outflow) - overflow);
  outflow = (valve * level);
  overflow = (if (level > edge) then (weir * (level - edge)) else 0);

end More_Tank;

