model RoadVehicle "longitudinal motion of a car; torque at the wheels and slope of the road are recorded"
  constant Real g(unit = "m/s2") = 9.80665;
  parameter Real mass(unit = "kg", min = 0.0) = 1450.0;
  parameter Real wheel_inertia(unit = "kg.m2", min = 0.0) = 4.0 "of all wheels and what turns with them";
  parameter Real wheel_radius(unit = "m", min = 0.0) = 0.31;
  parameter Real rolling_resistance(unit = "1", min = 0.0) = 0.011;
  parameter Real rolling_growth(unit = "s/m", min = 0.0) = 1e-4 "of the coefficient with speed";
  parameter Real drag_area(unit = "m2", min = 0.0) = 0.66;
  parameter Real air_density(unit = "kg/m3", min = 0.0) = 1.2;
  input Real torque(unit = "N.m") "at the wheels; negative where the brakes act";
  input Real slope(unit = "rad") "angle of the road, positive uphill";
  output Real speed(unit = "m/s", start = 0.0);
  Real wheel_speed(unit = "rad/s");
  Real resistance(unit = "N") "of tyres, slope and air, for a car that rolls forward";
equation
  speed = wheel_radius*wheel_speed;
  resistance = mass*g*((rolling_resistance + rolling_growth*speed)*cos(slope) + sin(slope)) + 0.5*air_density*drag_area*speed^2;
  (wheel_inertia + mass*wheel_radius^2)*der(wheel_speed) = torque - wheel_radius*resistance;
end RoadVehicle;
