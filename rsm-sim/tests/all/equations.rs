//! Plants of equations along records, compared with solutions calculated by hand.

use rsm_core::source::{Faults, Source};
use rsm_sim::equations::{EquationFile, Machine, Method, Setting, Signals, linearise};

/// The plant file of a text.
pub(super) fn file(plant: &str, text: &str) -> Result<EquationFile, Faults> {
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, text));
    EquationFile::read(&Source::new("plant.toml", format!("format = 2\nmodel = \"plant.mo\"\n{plant}")), &open)
}

pub(super) fn machine(plant: &str, text: &str) -> (EquationFile, Machine) {
    let file = file(plant, text).unwrap_or_else(|faults| panic!("{faults}"));
    let machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
    (file, machine)
}

fn machine_of(text: &str) -> (EquationFile, Machine) {
    machine("", text)
}

/// The outputs of a text over rows with a constant period, with inputs by name.
pub(super) fn outputs(
    plant: &str,
    text: &str,
    setting: Setting,
    rows: usize,
    period: f64,
    inputs: &[(&str, &dyn Fn(f64) -> f64)],
) -> Vec<Vec<f64>> {
    let (file, mut machine) = machine(plant, text);
    let time: Vec<f64> = (0..rows).map(|k| k as f64 * period).collect();
    let values: Vec<Vec<f64>> = inputs.iter().map(|(_, of)| time.iter().map(|time| of(*time)).collect()).collect();
    let mut columns: Vec<(&str, &[f64])> = vec![("time", &time)];
    columns.extend(inputs.iter().zip(&values).map(|((name, _), values)| (*name, values.as_slice())));
    let signals = Signals::in_memory(&file, &machine, &columns).unwrap_or_else(|faults| panic!("{faults}"));
    signals.simulate(&file, &mut machine, setting).unwrap_or_else(|failed| panic!("{failed:?}"))
}

pub(super) fn by(method: Method, tolerance: f64) -> Setting {
    Setting::new(method, tolerance)
}

const AXIS: &str = "model Axis\n  parameter Real mass(unit = \"kg\") = 95.1;\n  parameter Real friction(unit = \"N.s/m\") = 203.5;\n  \
    input Real force(unit = \"N\");\n  output Real position(unit = \"m\");\n  output Real speed(unit = \"m/s\", start = 0.3);\nequation\n  \
    mass*der(speed) = force - friction*speed;\n  der(position) = speed;\nend Axis;\n";

/// Position and speed of the axis after a start with a given speed, under a constant force.
fn axis(time: f64, start: f64, force: f64, mass: f64) -> (f64, f64) {
    let (friction, end) = (203.5, force / 203.5);
    let decay = (-friction / mass * time).exp();
    (end * time + (start - end) * mass / friction * (1.0 - decay), end + (start - end) * decay)
}

#[test]
fn every_method_follows_an_exponential_to_its_tolerance() {
    for (method, tolerance) in [
        (Method::Explicit, 1e-10),
        (Method::Stiff, 1e-8),
        (Method::Automatic, 1e-6),
        // 10 steps per row: the error is (b h/m)^5/120 per step.
        (Method::Fixed { step: 0.001 }, 1e-9),
    ] {
        let found = outputs("[parameters]\nmass = 47.0\n", AXIS, by(method, tolerance), 101, 0.01, &[("force", &|_| 70.0)]);
        for k in [1, 37, 100] {
            let (position, speed) = axis(k as f64 * 0.01, 0.3, 70.0, 47.0);
            // At most, the errors of the steps add up over a hundred rows.
            let most = 100.0 * tolerance;
            assert!(
                (found[0][k] - position).abs() < most && (found[1][k] - speed).abs() < most,
                "{method:?} row {k}: {} {position}",
                found[0][k]
            );
        }
    }
}

#[test]
fn a_plant_at_rest_that_is_pushed_through_two_masses_runs() {
    // Positions at 0 with rates of 0 grow with the third and fifth power of the time, so no previous value is a scale for their error.
    let text = "model Two\n  input Real force;\n  Real x, v;\n  output Real y;\n  Real w;\nequation\n  der(x) = v;\n  der(v) = force + 50*(y - x);\n  \
        der(y) = w;\n  2*der(w) = -50*(y - x);\nend Two;\n";
    for method in [Method::Explicit, Method::Stiff, Method::Automatic] {
        let push = |time: f64| if time < 0.045 { 0.0 } else { 3.0 };
        let found = outputs("", text, by(method, 1e-8), 21, 0.01, &[("force", &push)]);
        assert_eq!(found[0][5], 0.0);
        // The motion of the centre of mass and the twist, each by hand: 3 kg, and 75/s^2 with the force on the lighter mass.
        let since: f64 = 0.15;
        let (centre, twist) = (0.5 * since * since, 3.0 / 75.0 * (1.0 - (75.0_f64.sqrt() * since).cos()));
        let wanted = centre - twist / 3.0;
        // The errors of the steps of the stiff method, order 3, add up to some hundred times the error of one.
        assert!((found[0][20] / wanted - 1.0).abs() < 1e-5, "{method:?}: {} {wanted}", found[0][20]);
    }
}

#[test]
fn a_bounce_is_located_and_the_ball_goes_on_from_there() {
    let text = "model Ball\n  parameter Real e = 0.8;\n  output Real height(start = 1.0, fixed = true);\n  Real speed(start = 0.0, fixed = true);\n  \
        output Integer bounces(start = 0);\nequation\n  der(height) = speed;\n  der(speed) = -9.81;\n  when height < 0.0 then\n    \
        reinit(speed, -e*pre(speed));\n    bounces = pre(bounces) + 1;\n  end when;\nend Ball;\n";
    let (rows, period) = (21, 0.1);
    let found = outputs("", text, by(Method::Automatic, 1e-10), rows, period, &[]);
    // The height and the number of bounces, by hand.
    let by_hand = |time: f64| {
        let (g, e) = (9.81_f64, 0.8_f64);
        let (mut begin, mut up, mut count) = (0.0, 0.0, 0.0);
        let mut last = (2.0 / g).sqrt();
        let mut start = 1.0;
        while begin + last < time {
            let speed = up - g * last;
            begin += last;
            (up, start, count) = (-e * speed, 0.0, count + 1.0);
            last = 2.0 * up / g;
        }
        let since = time - begin;
        (start + up * since - 0.5 * g * since * since, count)
    };
    for (row, (found, bounces)) in found[0].iter().zip(&found[1]).enumerate() {
        let (height, count) = by_hand(row as f64 * period);
        // The method is exact for a parabola. The instant is located to its last bits, and its error changes the height by the speed of 4 m/s times
        // this error.
        assert!((found - height).abs() < 1e-12, "row {row}: {found} {height}");
        assert_eq!(*bounces, count, "row {row}");
    }
    assert_eq!(found[1][rows - 1], 3.0);
}

#[test]
fn a_condition_that_changes_twice_inside_a_step_is_not_stepped_over() {
    // x is above the border for 0.02 s in the middle of each second. A comparison only at the rows would miss the count.
    let text = "model M\n  output Real x(start = 0.0);\n  output Integer count(start = 0);\nequation\n  der(x) = 6.283185307179586*cos(6.283185307179586*time);\n  \
        when x > 0.998 then\n    count = pre(count) + 1;\n  end when;\nend M;\n";
    let found = outputs("", text, by(Method::Explicit, 1e-9), 6, 1.0, &[]);
    assert_eq!(found[1], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
}

#[test]
fn a_sampled_controller_holds_its_output_between_instants() {
    let text = "model Sampled\n  parameter Real Ts = 0.01;\n  input Real reference;\n  output Real y(start = 0.0, fixed = true);\n  \
        discrete output Real u(start = 0.0);\nequation\n  0.1*der(y) = u - y;\n  when sample(0.0, Ts) then\n    u = 2*(reference - y);\n  end when;\nend Sampled;\n";
    // Rows at 4 ms and instants at 10 ms: most are different, some coincide.
    let found = outputs("", text, by(Method::Explicit, 1e-12), 26, 0.004, &[("reference", &|_| 1.0)]);
    let (mut y, mut at) = (0.0_f64, 0.0_f64);
    let mut u = 2.0;
    let mut instants = 1;
    for row in 0..26 {
        let time = f64::from(row) * 0.004;
        while f64::from(instants) * 0.01 <= time + 1e-12 {
            let next = f64::from(instants) * 0.01;
            y = u + (y - u) * (-(next - at) / 0.1).exp();
            (at, u) = (next, 2.0 * (1.0 - y));
            instants += 1;
        }
        let value = u + (y - u) * (-(time - at) / 0.1).exp();
        assert!((found[0][row as usize] - value).abs() < 1e-10, "row {row}: {} {value}", found[0][row as usize]);
        assert!((found[1][row as usize] - u).abs() < 1e-10, "row {row}: {} {u}", found[1][row as usize]);
    }
}

#[test]
fn a_record_that_begins_late_has_the_instants_of_its_controller() {
    // Each instant adds 1; rows every 4 ms, instants every 10 ms. The first row is at an instant, or between two instants.
    let text = "model Counter\n  input Real u;\n  discrete output Real count(start = 0.0);\nequation\n  when sample(0.0, 0.01) then\n    count = pre(count) + u;\n  end when;\nend Counter;\n";
    let (file, mut machine) = machine("", text);
    for (begin, first) in [(5.0, 500), (5.003, 501), (-0.02, 0)] {
        let time: Vec<f64> = (0..30).map(|k| begin + 0.004 * f64::from(k)).collect();
        let ones = [1.0; 30];
        let signals = Signals::in_memory(&file, &machine, &[("time", &time), ("u", &ones)]).unwrap();
        let found = signals.simulate(&file, &mut machine, by(Method::Explicit, 1e-8)).unwrap();
        for (row, time) in time.iter().enumerate() {
            let instants = (first..first + 40).filter(|k| f64::from(*k) * 0.01 <= time + 1e-12).count() as f64;
            assert_eq!(found[0][row], instants, "begin {begin}, row {row}");
        }
    }
}

#[test]
fn the_loop_of_the_shipped_axis_is_computed_at_the_rows_of_a_record_that_begins_late() {
    let text = Source::new("axis.toml", "format = 2\nmodel = \"rsm:servo-axis#ServoAxisClosedLoop\"\n");
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, ""));
    let file = EquationFile::read(&text, &open).unwrap_or_else(|faults| panic!("{faults}"));
    let along = |begin: f64| {
        let time: Vec<f64> = (0..40).map(|k| begin + 0.002 * f64::from(k)).collect();
        let reference: Vec<f64> = (0..40).map(|k| 1e-3 * f64::from(k)).collect();
        let columns: [(&str, &[f64]); 2] = [("time", &time), ("reference", &reference)];
        let file = file.of_columns(&columns).unwrap();
        let mut machine = Machine::new(&file).unwrap();
        let signals = Signals::in_memory(&file, &machine, &columns).unwrap();
        signals.simulate(&file, &mut machine, by(Method::Explicit, 1e-10)).unwrap()
    };
    let (now, late) = (along(0.0), along(3.00037));
    for (a, b) in now.iter().flatten().zip(late.iter().flatten()) {
        // The last digits of the clock: 4e-16 of 3 s, times about 100/s.
        assert!((a - b).abs() <= 1e-9 * a.abs().max(1e-3), "{a} {b}");
    }
}

#[test]
fn a_stiff_plant_is_followed_in_reasonable_steps() {
    // H. H. Robertson, 1966; the solution at t = 0.4, 4 and 40 from E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", IV.10, and
    // from LSODE's manual.
    let text = "model Robertson\n  output Real a(start = 1.0);\n  output Real b(start = 0.0, nominal = 1e-5);\n  output Real c(start = 0.0);\nequation\n  \
        der(a) = -0.04*a + 1e4*b*c;\n  der(b) = 0.04*a - 1e4*b*c - 3e7*b*b;\n  der(c) = 3e7*b*b;\nend Robertson;\n";
    for method in [Method::Stiff, Method::Automatic] {
        let found = outputs("", text, by(method, 1e-7), 101, 0.4, &[]);
        let wanted = [
            (1, [9.8517e-1, 3.3864e-5, 1.4794e-2]),
            (10, [9.0552e-1, 2.2405e-5, 9.4458e-2]),
            (100, [7.1583e-1, 9.1856e-6, 2.8416e-1]),
        ];
        for (row, wanted) in wanted {
            for (found, wanted) in found.iter().zip(wanted) {
                // The sources print five digits.
                assert!((found[row] / wanted - 1.0).abs() < 5e-5, "{method:?} row {row}: {} {wanted}", found[row]);
            }
        }
    }
}

#[test]
fn the_start_comes_from_the_file_the_record_and_the_text() {
    let (file, machine) = machine("[initial]\nspeed = -0.2\n", AXIS);
    let time = [0.0, 0.1];
    let of = |columns: &[(&str, &[f64])]| {
        let signals = Signals::in_memory(&file, &machine, columns).unwrap();
        {
            let (a, b) = signals.start(&file, &machine);
            a.into_iter().chain(b)
        }
        .map(|it| (it.name, it.value))
        .collect::<Vec<_>>()
    };
    let found = of(&[("time", &time), ("force", &[0.0; 2]), ("position", &[0.5, 0.6]), ("speed", &[0.1, 0.1])]);
    assert_eq!(found, [("speed".to_string(), -0.2), ("position".to_string(), 0.5)]);
    assert_eq!(of(&[("time", &time), ("force", &[0.0; 2])]), [("speed".to_string(), -0.2)]);
}

#[test]
fn the_shipped_texts_follow_the_plants_that_are_built_in() {
    use rsm_sim::{plant_file::PlantFile, record::Record, simulate::Simulator};
    // The motor along its shipped record. The plant file of format 1 and the text run on the same engine, with the default tolerance and with 1e-9.
    let old = PlantFile::read(&Source::read("plants/pmac.toml".as_ref()).unwrap()).unwrap();
    let source = Source::read("plants/pmac.csv".as_ref()).unwrap();
    let record = Record::read(&source, &old).unwrap();
    let wanted = Simulator::new(&old, &record).unwrap().run(&record).unwrap();
    let names = rsm_sim::schema::parameters(old.kind).iter().map(|it| it.name);
    let numbers: String = names.filter_map(|name| Some(format!("{name} = {:?}\n", old.parameters.optional(name)?))).collect();
    let plant = format!("format = 2\nmodel = \"rsm:pmac\"\n[parameters]\n{numbers}");
    let open = |name: &str| Err(Faults::one(rsm_core::source::Fault::whole_file(name, "not asked for")));
    let file = EquationFile::read(&Source::new("motor.toml", plant), &open).unwrap_or_else(|faults| panic!("{faults}"));
    let mut machine = Machine::new(&file).unwrap_or_else(|faults| panic!("{faults}"));
    let signals = Signals::read(&source, &file, &machine).unwrap_or_else(|faults| panic!("{faults}"));
    let found =
        signals.simulate(&file, &mut machine, by(Method::Automatic, 1e-9)).unwrap_or_else(|failed| panic!("{failed:?}"));
    for ((name, _), values) in machine.outputs().iter().zip(&found) {
        let Some(wanted) = wanted.of(name) else { continue };
        let size = wanted.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
        let off = wanted.iter().zip(values).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        // The default tolerance is 1e-8 per step, so the limit of 1e-4 of the size of a signal leaves a wide margin.
        assert!(off < 1e-4 * size, "{name}: {off} of {size}");
    }
    let read = |model: &str| EquationFile::read(&Source::new("m.toml", format!("format = 2\nmodel = \"{model}\"\n")), &open);
    assert!(read("rsm:glider").unwrap_err().to_string().contains("shipped are `rsm:pmac`"));
}

#[test]
fn columns_are_converted_to_the_units_of_the_text() {
    let plant = "[columns]\nforce = \"F\"\nposition = { name = \"x\", unit = \"mm\" }\n";
    let (file, mut machine) = machine(plant, AXIS);
    let csv = "time[ms],F[kN],x\n0,0.07,250\n10,0.07,0\n20,0.07,0\n";
    let signals = Signals::read(&Source::new("r.csv", csv), &file, &machine).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!((signals.inputs[0][0], signals.measured[0].as_ref().unwrap()[0], signals.time[2]), (70.0, 0.25, 0.02));
    let found = signals.simulate(&file, &mut machine, Setting::default()).unwrap();
    let (moved, _) = axis(0.02, 0.3, 70.0, 95.1);
    assert!((found[0][2] - 0.25 - moved).abs() < 1e-9);
}

#[test]
fn a_surface_stands_for_a_function_and_has_its_derivative() {
    let text = "package Fans\n  function drag\n    input Real w;\n    output Real torque;\n  end drag;\n  model Fan\n  output Real speed(start = 100.0);\n\
        equation\n  2*der(speed) = -drag(speed);\n  end Fan;\nend Fans;\n";
    // The coefficients of torque = 3e-4 w^2 on 0 to 200: x = (w - 100)/100, 3 (1 + 2 x + x^2).
    let map = "format = 1\nmodel = \"fan\"\n[inputs.w]\nunit = \"rad/s\"\nrange = [0.0, 200.0]\n[surfaces.torque]\nunit = \"N*m\"\ninputs = [\"w\"]\n\
        terms = [{ powers = [0], coefficient = 3.0 }, { powers = [1], coefficient = 6.0 }, { powers = [2], coefficient = 3.0 }]\n";
    let open = |name: &str| Ok::<_, Faults>(Source::new(name, if name == "fan.mo" { text } else { map }));
    let plant = "format = 2\nmodel = \"fan.mo\"\n[functions]\ndrag = { model = \"map.toml\", surface = \"torque\" }\n";
    let file = EquationFile::read(&Source::new("fan.toml", plant), &open).unwrap_or_else(|faults| panic!("{faults}"));
    let mut machine = Machine::new(&file).unwrap();
    let time: Vec<f64> = (0..11).map(f64::from).collect();
    let signals = Signals::in_memory(&file, &machine, &[("time", &time)]).unwrap();
    // The solution is w = 100/(1 + 100 c t), c = 1.5e-4.
    for method in [Method::Explicit, Method::Stiff] {
        let found = signals.simulate(&file, &mut machine, by(method, 1e-9)).unwrap();
        assert!((found[0][10] - 100.0 / 1.15).abs() < 1e-5, "{method:?} {}", found[0][10]);
    }
    let point = machine.start(&file, 0.0, &[], &[]).unwrap();
    let linear = linearise(&file, &machine, &point).unwrap();
    // The derivative is -2 c w = -0.03/s.
    assert!((linear.a[0][0] + 0.03).abs() < 1e-12, "{:?}", linear.a);
}

#[test]
fn a_joint_with_free_play_starts_on_the_side_that_its_torque_presses() {
    // The iteration ends for any torque and gap, although Newton's method may alternate between two neighbouring numbers.
    let text = "model Joint\n  input Real torque(unit = \"N.m\");\n  input Real gap(unit = \"rad\");\n  output Real twist(unit = \"rad\");\n  \
        parameter Real stiffness(unit = \"N.m/rad\") = 5000.0;\n  parameter Real lag(unit = \"s\") = 1.0;\ninitial equation\n  stiffness*(twist - sign(twist)*gap/2) = torque;\nequation\n  \
        lag*der(twist) = -twist;\nend Joint;\n";
    let (file, mut machine) = machine_of(text);
    let mut state = 20_261_125_u64;
    let mut uniform = || crate::uniform(&mut state);
    for _ in 0..400 {
        let (torque, gap) = (2000.0 * uniform() - 1000.0, 0.1 * uniform());
        let point = machine.start(&file, 0.0, &[torque, gap], &[]).unwrap_or_else(|faults| panic!("{torque} {gap}: {faults}"));
        let expected = torque / 5000.0 + torque.signum() * gap / 2.0;
        // The residual is rounded twice, with the magnitude of the torque, and the result once.
        let bound = f64::EPSILON * (2.0 * torque.abs() / 5000.0 + expected.abs());
        assert!((point.states[0] - expected).abs() <= bound, "{torque} {gap}: {} {expected}", point.states[0]);
    }
}

#[test]
fn a_linear_model_has_exact_derivatives_poles_and_damping() {
    // A mass on a spring whose force has a cubic term, with an external force and a velocity sensor.
    let text = "model M\n  input Real force(unit = \"N\");\n  Real x(start = 0.5);\n  Real v;\n  output Real speed;\n  output Real push;\nequation\n  \
        der(x) = v;\n  2*der(v) = force - 0.4*v - 8*x - 16*x^3;\n  speed = v;\n  push = 3*force + x;\nend M;\n";
    let (file, mut machine) = machine("", text);
    let point = machine.start(&file, 0.0, &[0.0], &[]).unwrap();
    let found = linearise(&file, &machine, &point).unwrap();
    // The stiffness at 0.5: 8 + 48*0.25 = 20 N/m.
    assert_eq!(found.a, [[0.0, 1.0], [-10.0, -0.2]]);
    assert_eq!((&found.b, &found.c), (&vec![vec![0.0], vec![0.5]], &vec![vec![0.0, 1.0], vec![1.0, 0.0]]));
    assert_eq!(found.d, [[0.0], [3.0]]);
    // A free mass has two poles at exactly 0. If a derivative is not finite, there are no poles.
    let of = |text: &str| {
        let (file, mut machine) = machine_of(text);
        let point = machine.start(&file, 0.0, &[], &[]).unwrap();
        linearise(&file, &machine, &point).unwrap().poles
    };
    let free = of(
        "model F\n  Real x(start = 1.0), v, w;\nequation\n  der(x) = v;\n  der(v) = 3*(w - v) - 2*(v - w);\n  der(w) = 5*(v - w);\nend F;\n",
    );
    assert_eq!(free.iter().filter(|it| it.frequency() == 0.0 && it.damping().is_none()).count(), 2, "{free:?}");
    assert!(of("model R\n  Real x(start = 0.0);\nequation\n  der(x) = 1 - sqrt(x);\nend R;\n").is_empty());
    let [first, second] = found.poles[..] else { panic!("{:?}", found.poles) };
    assert!(
        (first.frequency() - 10_f64.sqrt()).abs() < 1e-12 && (first.damping().unwrap() - 0.1 / 10_f64.sqrt()).abs() < 1e-12
    );
    assert!(first.imaginary > 0.0 && (first.imaginary + second.imaginary).abs() < 1e-12);
}

#[test]
fn faults_of_a_plant_file_name_their_place_and_what_the_text_has() {
    let told = |plant: &str| file(plant, AXIS).err().map(|faults| faults.to_string()).unwrap_or_default();
    for (plant, words) in [
        ("[parameters]\nmasss = 3\n", "plant.toml:4:1: [parameters]: the text has no parameter `masss`"),
        ("[tolerance]\nmass = -0.1\n", "found -0.1, expected a number that is not negative"),
        ("[noise]\nforce = 1\n", "[noise]: the text has no output `force`"),
        ("[initial]\nv = 1\n", "[initial]: the text has no variable `v`"),
        ("[columns]\nspin = \"n\"\n", "[columns]: the text has no input or output `spin`"),
        (
            "[functions]\nmap = { model = \"m.toml\", surface = \"s\" }\n",
            "[functions]: the text has no function without an algorithm `map`",
        ),
        ("[[effects]]\nkind = \"backlash\"\n", "it needs a joint or translation"),
        ("[[effects]]\nkind = \"backslash\"\n", "no effect is called `backslash`"),
        ("parts = 1\n", "`parts`"),
    ] {
        assert!(told(plant).contains(words), "{plant}\n{}", told(plant));
    }
    let (file, machine) = machine("", AXIS);
    let read = |csv: &str| Signals::read(&Source::new("r.csv", csv), &file, &machine).unwrap_err().to_string();
    assert!(read("time[s],speed[m/s]\n0,0\n1,0\n").contains("the record has no column `force`"));
    assert!(read("time[s],force[V]\n0,0\n1,0\n").contains("measure different things"));
}
