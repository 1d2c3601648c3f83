
// BaseModelica — More_Cylinder "a hydraulic cylinder behind a proportional valve"

model More_Cylinder "a hydraulic cylinder behind a proportional valve"

  // --- variable declarations ---
  parameter Real supply(unit = "Pa", start = 10000000.0) = 10000000.0;
  parameter Real k(start = 0.0000002) = 0.0000002;
  parameter Real area(unit = "m2", start = 0.001) = 0.001;
  parameter Real volume(unit = "m3", start = 0.0005) = 0.0005;
  parameter Real bulk(unit = "Pa", start = 1200000000.0) = 1200000000.0;
  parameter Real mass(unit = "kg", start = 50) = 50;
  parameter Real damping(unit = "N.s/m", start = 800) = 800;
  parameter Real spring(unit = "N/m", start = 20000) = 20000;
  input Real opening(start = 0.0);
  Real a(unit = "Pa", start = 2000000.0, fixed = true);
  Real b(unit = "Pa", start = 2000000.0, fixed = true);
  output Real position(unit = "m", start = 0, fixed = true);
  Real speed(unit = "m/s", start = 0, fixed = true);
  Real qa(unit = "m3/s", start = 0.0);
  Real qb(unit = "m3/s", start = 0.0);

equation
  // --- continuous equations ---
  qa = (((k * opening) * sign((supply - a))) * sqrt(abs((supply - a))));
  qb = (((k * opening) * sign(b)) * sqrt(abs(b)));
  ((der(a) * (volume + (area * position))) / bulk) = (qa - (area * speed));
  ((der(b) * (volume - (area * position))) / bulk) = ((area * speed) - qb);
  der(position) = speed;
  (mass * der(speed)) = (((area * (a - b)) - (damping * speed)) - (spring * position));

end More_Cylinder;

