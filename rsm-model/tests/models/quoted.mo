//! base 0.1.0
package 'TwoInertias'
  type 'Angle' = Real(quantity = "Angle", unit = "rad", displayUnit = "deg");
  type 'Torque' = Real(quantity = "Torque", unit = "N.m");

  model 'TwoInertias' "two inertias with a spring, in OpenModelica's form"
    input Real 'torque'(unit = "N.m");
    output Real 'speed'(unit = "rad/s");
    parameter Real 'motor.J'(min = 0.0, unit = "kg.m2") = 0.1 "inertia";
    parameter Real 'load.J'(min = 0.0, unit = "kg.m2") = 2.0 "inertia";
    parameter Real 'shaft.c'(unit = "N.m/rad") = 300.0;
    parameter Real 'shaft.d'(unit = "N.m.s/rad") = 0.4;
    'Angle' 'motor.phi'(fixed = true, start = 0.0);
    Real 'motor.w'(unit = "rad/s", fixed = true, start = 0.0);
    'Angle' 'load.phi'(fixed = true, start = 0.0);
    Real 'load.w'(unit = "rad/s", fixed = true, start = 0.0);
    'Angle' 'shaft.twist';
    'Torque' 'shaft.tau';
  equation
    'motor.w' = der('motor.phi');
    'motor.J' * der('motor.w') = 'torque' + 'shaft.tau' "balance of the motor" annotation(source = "Inertia");
    'load.w' = der('load.phi');
    'load.J' * der('load.w') = -'shaft.tau';
    'shaft.twist' = 'load.phi' - 'motor.phi';
    'shaft.tau' = 'shaft.c' * 'shaft.twist' + 'shaft.d' * der('shaft.twist');
    'speed' = 'load.w';
    annotation(experiment(StopTime = 1.0));
  end 'TwoInertias';
end 'TwoInertias';
