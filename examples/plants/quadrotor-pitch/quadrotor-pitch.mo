model QuadrotorPitch "pitch axis of a quadrotor that hangs in a gimbal; the rotors answer with a lag"
  constant Real g(unit = "m/s2") = 9.80665;
  parameter Real inertia(unit = "kg.m2", min = 0.0) = 0.015;
  parameter Real arm(unit = "m", min = 0.0) = 0.2;
  parameter Real rotor_lag(unit = "s", min = 0.0) = 0.05;
  parameter Real mass(unit = "kg", min = 0.0) = 1.2;
  parameter Real hang(unit = "m") = 0.01 "height of the gimbal's axis above the centre of mass";
  parameter Real damping(unit = "N.m.s/rad", min = 0.0) = 0.02 "of rotors and gimbal";
  input Real front(unit = "N") "thrust that is asked of the front rotors";
  input Real rear(unit = "N") "thrust that is asked of the rear rotors";
  output Real pitch_rate(unit = "rad/s", start = 0.0);
  output Real pitch(unit = "rad", start = 0.0) "positive with the nose up";
  Real front_thrust(unit = "N");
  Real rear_thrust(unit = "N");
initial equation
  front_thrust = front;
  rear_thrust = rear;
equation
  rotor_lag*der(front_thrust) = front - front_thrust;
  rotor_lag*der(rear_thrust) = rear - rear_thrust;
  inertia*der(pitch_rate) = arm*(front_thrust - rear_thrust) - damping*pitch_rate - mass*g*hang*sin(pitch);
  der(pitch) = pitch_rate;
end QuadrotorPitch;
