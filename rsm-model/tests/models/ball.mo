model Ball "a ball that bounces"
  parameter Real g(unit = "m/s2") = 9.81;
  parameter Real restitution = 0.8;
  output Real height(unit = "m", start = 1.0, fixed = true);
  Real speed(unit = "m/s", start = 0.0, fixed = true);
  Integer bounces(start = 0);
equation
  der(height) = speed;
  der(speed) = -g;
  when height < 0.0 then
    reinit(speed, -restitution*pre(speed));
    bounces = pre(bounces) + 1;
  end when;
end Ball;
