// Equations of docs/book/src/reference/plants.md, section 2.2, numbers (27), (28) of the paper there.
// A minimum of 1e-60, the constant `small` of Modelica, excludes 0. Nominal sizes of a start: the torque of full throttle, the twist that carries
// it in second gear, and this twist times the rate of the slowest oscillation, 20 rad/s.
model Driveline "engine, clutch, transmission, driveshaft, wheel and vehicle, in one gear"
  constant Real g(unit = "m/s2") = 9.80665 "standard gravity";
  parameter Real engine_inertia(unit = "kg.m2", min = 1e-60) = 0.17;
  parameter Real transmission_inertia(unit = "kg.m2", min = 1e-60) = 0.014;
  parameter Real final_drive_inertia(unit = "kg.m2", min = 0.0) = 0.031;
  parameter Real wheel_inertia(unit = "kg.m2", min = 1e-60) = 1.0;
  parameter Real mass(unit = "kg", min = 1e-60) = 1560.0;
  parameter Real wheel_radius(unit = "m", min = 1e-60) = 0.32;
  parameter Real gear_ratios[5](each unit = "1", each min = 1e-60) = {3.5, 2.2, 1.5, 1.1, 0.9};
  parameter Integer gear(min = 1, max = 5) = 1 "constant in a record";
  parameter Real final_drive_ratio(unit = "1", min = 1e-60) = 3.7;
  parameter Real clutch_stiffness(unit = "N.m/rad", min = 1e-60) = 10000.0;
  parameter Real clutch_damping(unit = "N.m.s/rad", min = 0.0) = 30.0;
  parameter Real driveshaft_stiffness(unit = "N.m/rad", min = 1e-60) = 5000.0 "at the wheel";
  parameter Real driveshaft_damping(unit = "N.m.s/rad", min = 0.0) = 65.0 "at the wheel";
  parameter Real transmission_damping(unit = "N.m.s/rad", min = 0.0) = 0.1;
  parameter Real final_drive_damping(unit = "N.m.s/rad", min = 0.0) = 0.1;
  parameter Real wheel_damping(unit = "N.m.s/rad", min = 0.0) = 0.1;
  parameter Real rolling_resistance_1(unit = "m/s2", min = 0.0) = 0.0980665;
  parameter Real rolling_resistance_2(unit = "m/s", min = 0.0) = 0.0 "deceleration per speed of the wheel";
  parameter Real drag_area(unit = "m2", min = 0.0) = 0.81;
  parameter Real air_density(unit = "kg/m3", min = 0.0) = 1.2;
  parameter Real grade(unit = "rad", min = -1.5707963267948966, max = 1.5707963267948966) = 0.0 "a slope steeper than vertical is not possible";
  parameter Real torque_0(unit = "N.m") = 120.0;
  parameter Real torque_1(unit = "N.m.s/rad") = 0.6;
  parameter Real torque_2(unit = "N.m.s2/rad2") = -0.001;
  parameter Real torque_lag(unit = "s", min = 1e-60) = 0.1;
  parameter Real engine_friction_0(unit = "N.m", min = 0.0) = 15.0;
  parameter Real engine_friction_1(unit = "N.m.s/rad", min = 0.0) = 0.03;
  parameter Real torque_offset(unit = "N.m", nominal = 200.0) = 0.0 "at the start: torque of the engine beyond that of a steady roll";
  parameter Real twist_offset(unit = "rad", nominal = 0.4) = 0.0 "at the start: twist of the driveshaft beyond that of a steady roll";
  parameter Real twist_rate(unit = "rad/s", nominal = 8.0) = 0.0 "at the start: how fast the driveshaft twists";
  input Real throttle(unit = "1") "0 to 1";
  output Real engine_speed(unit = "rad/s", start = 0.0);
  output Real road_speed(unit = "m/s", start = 0.0);
  output Real acceleration(unit = "m/s2");
  Real engine_torque(unit = "N.m", start = 0.0);
  Real commanded_torque(unit = "N.m");
  Real engine_friction(unit = "N.m");
  Real engine_angle(unit = "rad", start = 0.0);
  Real shaft_angle(unit = "rad", start = 0.0);
  Real shaft_speed(unit = "rad/s", start = 0.0);
  Real wheel_angle(unit = "rad", start = 0.0);
  Real wheel_speed(unit = "rad/s", start = 0.0);
  Real clutch_twist(unit = "rad");
  Real clutch_rate(unit = "rad/s");
  Real clutch_torque(unit = "N.m");
  Real driveshaft_twist(unit = "rad");
  Real driveshaft_rate(unit = "rad/s");
  Real driveshaft_torque(unit = "N.m");
  Real resistance(unit = "N") "of the road and the air";
initial equation
  // A car that rolls steadily with what the engine gives, from the road speed alone, and by how much it differs from that. The shaft between is light: the clutch carries what the driveshaft does.
  shaft_speed = final_drive_ratio*(wheel_speed + twist_rate);
  engine_speed = gear_ratios[gear]*shaft_speed;
  engine_torque = torque_offset + throttle*(torque_0 + torque_1*(gear_ratios[gear]*final_drive_ratio*wheel_speed)
    + torque_2*(gear_ratios[gear]*final_drive_ratio*wheel_speed)^2);
  shaft_angle = 0.0;
  clutch_stiffness*clutch_twist = engine_torque - torque_offset - engine_friction_0 - engine_friction_1*(gear_ratios[gear]*final_drive_ratio*wheel_speed)
    + driveshaft_stiffness*twist_offset/(gear_ratios[gear]*final_drive_ratio);
  driveshaft_stiffness*driveshaft_twist = gear_ratios[gear]*final_drive_ratio*(engine_torque - torque_offset - engine_friction_0
    - engine_friction_1*(gear_ratios[gear]*final_drive_ratio*wheel_speed)) + driveshaft_stiffness*twist_offset;
equation
  commanded_torque = throttle*(torque_0 + torque_1*engine_speed + torque_2*engine_speed^2);
  torque_lag*der(engine_torque) = commanded_torque - engine_torque;
  engine_friction = engine_friction_0 + engine_friction_1*engine_speed;
  clutch_twist = engine_angle - gear_ratios[gear]*shaft_angle;
  clutch_rate = engine_speed - gear_ratios[gear]*shaft_speed;
  clutch_torque = clutch_stiffness*clutch_twist + clutch_damping*clutch_rate;
  driveshaft_twist = shaft_angle/final_drive_ratio - wheel_angle;
  driveshaft_rate = shaft_speed/final_drive_ratio - wheel_speed;
  driveshaft_torque = driveshaft_stiffness*driveshaft_twist + driveshaft_damping*driveshaft_rate;
  der(engine_angle) = engine_speed;
  engine_inertia*der(engine_speed) = engine_torque - engine_friction - clutch_torque;
  der(shaft_angle) = shaft_speed;
  (transmission_inertia + final_drive_inertia/final_drive_ratio^2)*der(shaft_speed) = gear_ratios[gear]*clutch_torque
    - (transmission_damping + final_drive_damping/final_drive_ratio^2)*shaft_speed - driveshaft_torque/final_drive_ratio;
  der(wheel_angle) = wheel_speed;
  resistance = mass*(rolling_resistance_1 + rolling_resistance_2*wheel_speed + g*sin(grade)) + 0.5*drag_area*air_density*road_speed^2;
  (wheel_inertia + mass*wheel_radius^2)*der(wheel_speed) = driveshaft_torque - wheel_damping*wheel_speed - wheel_radius*resistance;
  road_speed = wheel_radius*wheel_speed;
  acceleration = wheel_radius*der(wheel_speed);
end Driveline;
