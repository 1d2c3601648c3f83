model Sampled "a first-order plant under a sampled controller with integral action"
  parameter Real Ts(unit = "s") = 0.01;
  parameter Real kp = 2.0;
  parameter Real ki(unit = "1/s") = 5.0;
  parameter Real T(unit = "s") = 0.1;
  input Real reference;
  output Real y(start = 0.0, fixed = true);
  discrete Real e(start = 0.0);
  discrete Real sum(start = 0.0);
  discrete Real u(start = 0.0);
equation
  T*der(y) = u - y;
  when sample(0.0, Ts) then
    u = kp*e + ki*sum;
    e = reference - y;
    sum = pre(sum) + Ts*e;
  end when;
end Sampled;
