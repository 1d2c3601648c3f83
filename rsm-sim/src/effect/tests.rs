//! Each effect is compared with cases worked out by hand: `cases.txt`.

use rsm_core::source::Source;

use super::*;
use crate::effects;
use crate::equation_plant::pmac;
use crate::kind::OUTPUTS;
use crate::plant_file::PlantFile;

/// The arguments of a hook: numbers by name, or words.
struct Given<'t>(Vec<(&'t str, &'t str)>);

impl<'t> Given<'t> {
    fn of(text: &'t str) -> Self {
        Given(text.split_whitespace().map(|entry| entry.split_once('=').expect("name=value")).collect())
    }

    fn word(&self, name: &str) -> Option<&'t str> {
        self.0.iter().find(|(found, _)| *found == name).map(|(_, value)| *value)
    }

    fn or(&self, name: &str, otherwise: f64) -> f64 {
        self.word(name).map_or(otherwise, number)
    }

    fn number(&self, name: &str) -> f64 {
        self.word(name).map(number).unwrap_or_else(|| panic!("`{name}` is not given"))
    }

    fn own(&self) -> Vec<f64> {
        self.word("own").unwrap_or("").split(',').filter(|text| !text.is_empty()).map(number).collect()
    }

    fn held(&self) -> Option<u32> {
        self.word("held").map(|text| text.parse().expect("a piece"))
    }

    fn joint(&self) -> Joint {
        match self.word("joint") {
            Some("clutch") => Joint::Clutch,
            Some("driveshaft") => Joint::Driveshaft,
            other => panic!("no joint: {other:?}"),
        }
    }

    fn motion(&self) -> Motion {
        Motion {
            position: self.or("position", 0.0),
            speed: self.or("speed", 0.0),
            viscous_friction: self.or("viscous_friction", 0.0),
        }
    }

    fn scale(&self) -> Scale {
        Scale {
            inertia: self.or("inertia", 8.0),
            drive_inertia: self.or("drive", 6.0),
            slowest: self.or("slowest", 0.0),
            change: self.or("change", 0.0),
            windings: Windings {
                inductance: self.or("inductance", 0.001),
                decay: self.or("decay", 100.0),
                swing: self.or("swing", 300.0),
                turning: self.or("turning", 100.0),
                current: (self.or("least", 0.0), self.or("most", 0.0)),
                change: self.or("moving", 0.0),
            },
            vehicle: Vehicle {
                wheel: (2.0, 0.4),
                speed: self.or("road", 20.0),
                crank_speed: self.or("crank", 200.0),
                clutch_mobility: 4.0,
                clutch: (10000.0, 2.0, self.or("twisting", 3.0)),
                swing: (100.0, 40.0),
            },
        }
    }

    fn survey(&self, plant: PlantKind) -> Survey {
        let text = match plant {
            _ if plant.is("pmac") => include_str!("../../plants/pmac.toml"),
            _ if plant.is("driveline") => include_str!("../../plants/driveline.toml"),
            _ => include_str!("../../plants/servo-axis.toml"),
        };
        let mut parameters = PlantFile::read(&Source::new("plant.toml", text)).expect("a sound file").parameters;
        if let Some(grade) = self.word("grade") {
            parameters.set("grade", number(grade));
        }
        Survey {
            plant,
            parameters,
            period: 0.01,
            duration: 40.0,
            input: 24.0,
            effort: 814.0,
            speed: 50.0,
            largest: of_outputs([3.0, 4.0, 200.0]),
            spread: of_outputs([10.0, 20.0, 30.0]),
            noise: of_outputs([0.1, 0.2, 0.3]),
            waves: vec![Wave { amplitude: 5.0, pitch: 0.01, phase: 0.3 }, Wave { amplitude: 2.0, pitch: 0.02, phase: -1.0 }],
            quantum: of_outputs([None, self.word("quantum").map(number), None]),
            scales: Vec::new(),
            exact: Vec::new(),
            unused: Vec::new(),
            output: self.or("output", 0.0) as usize,
            nominal: self.or("nominal", 0.0),
        }
    }
}

fn number(text: &str) -> f64 {
    text.parse().unwrap_or_else(|_| panic!("`{text}` is no number"))
}

/// The numbers of an effect, with the names of its description.
fn numbers(description: &Description, given: &Given<'_>) -> Vec<(&'static str, f64)> {
    let named = given.0.iter().filter(|(name, _)| *name != "of");
    let find = |name: &str| description.arguments.iter().find(|it| it.name == name).expect("a number of the effect").name;
    named.map(|(name, value)| (find(name), number(value))).collect()
}

fn flag(is: bool) -> f64 {
    if is { 1.0 } else { 0.0 }
}

/// The result of a hook: its value, then the values that it writes.
fn found(effect: &dyn Effect, plant: PlantKind, hook: &str, given: &Given<'_>) -> Vec<f64> {
    let own = given.own();
    let mut rates = vec![0.0; effect.states()];
    let mut start_of = |fill: &dyn Fn(&mut [f64])| {
        fill(&mut rates);
        rates.clone()
    };
    let value: Vec<f64> = match hook {
        "effort" => vec![effect.effort(&given.motion())],
        "load" => {
            let load = effect.load(&own, &mut rates);
            [vec![load], rates].concat()
        }
        "delay" => vec![effect.delay()],
        "reads_late" => vec![effect.reads_late(given.number("output") as usize)],
        "rate" => vec![effect.fastest_rate(&given.scale())],
        "nonlinear" => vec![effect.nonlinear_rate(&given.scale())],
        "flags" => {
            let [between, pieces, memory] =
                [effect.acts_between_rows(), effect.has_pieces(), effect.reads_with_memory()].map(flag);
            vec![between, effect.states() as f64, pieces, memory]
        }
        "frame_angle" => vec![effect.frame_angle(given.number("theta"))],
        "voltage_limit" => effect.voltage_limit([given.number("d"), given.number("q")]).to_vec(),
        "voltage_loss" => {
            let current = [given.number("i_d"), given.number("i_q")];
            effect.voltage_loss([given.number("d"), given.number("q")], current).to_vec()
        }
        "machine" => {
            let mut machine = Machine { resistance: 0.08, inductance: 9e-4, flux_linkage: 0.06 };
            let at = Currents { i_d: given.number("i_d"), i_q: given.number("i_q"), theta_e: given.or("theta_e", 0.0) };
            effect.machine(&at, &own, &mut rates, &mut machine);
            [vec![machine.resistance, machine.inductance, machine.flux_linkage], rates].concat()
        }
        "joint" => {
            let twist = Twist {
                joint: given.joint(),
                angle: given.number("angle"),
                rate: given.number("rate"),
                stiffness: given.number("stiffness"),
                damping: given.number("damping"),
            };
            let Carried { effort, piece } = effect.joint(&twist, given.number("effort"), given.held());
            vec![effort, f64::from(piece)]
        }
        "joint_limit" => {
            let Carried { effort, piece } = effect.joint_limit(given.joint(), given.number("effort"), given.held());
            vec![effort, f64::from(piece)]
        }
        "slack" => vec![effect.slack(given.joint())],
        "engine_torque" => vec![effect.engine_torque(given.number("torque"), given.number("angle"))],
        "start" => {
            let start = FirstInstant { motion: given.motion(), road_speed: given.number("road"), time: given.or("time", 0.0) };
            start_of(&|own| effect.start(&start, own))
        }
        "settle" => start_of(&|own| effect.settle(&[3.0, 4.0, 200.0], own)),
        "split" => effect.split().into_iter().collect(),
        "far_motion" => {
            let Motion { position, speed, viscous_friction } = effect.far_motion(&own);
            vec![position, speed, viscous_friction]
        }
        "passes" => {
            let body = Split {
                near: given.motion(),
                inertia: given.number("inertia"),
                load: given.number("load"),
                held: given.held(),
            };
            let Carried { effort, piece } = effect.passes(&body, &own, &mut rates);
            [vec![effort, f64::from(piece)], rates].concat()
        }
        "vehicle_speed" => effect.vehicle_speed(&own).into_iter().collect(),
        "traction" => {
            let contact = Contact {
                surface_speed: given.number("surface"),
                resistance: given.number("resistance"),
                mass: given.number("mass"),
            };
            let force = effect.traction(&contact, &own, &mut rates);
            [force.into_iter().collect(), rates].concat()
        }
        "reads" => {
            let output = given.number("output") as usize;
            let reading = effect.reads(output, given.number("value"), given.number("time"), &own, &mut rates);
            [vec![reading], rates].concat()
        }
        "truth" => vec![effect.truth(given.number("output") as usize, given.number("value"), given.number("time"))],
        "parameters" => {
            let mut parameters = given.survey(plant).parameters;
            effect.parameters(&mut parameters);
            vec![parameters.number(given.word("read").expect("a name"))]
        }
        _ => panic!("no hook `{hook}`"),
    };
    value
}

/// Equal except for the last bits, which a few rounding errors change; -0 equals 0.
fn close(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 1e-12 * expected.abs() || found.is_nan() && expected.is_nan()
}

fn all_close(found: &[f64], expected: &[f64]) -> bool {
    found.len() == expected.len() && found.iter().zip(expected).all(|(found, expected)| close(*found, *expected))
}

/// Reads a text such as `1 - n0=0 p2`: the numbers, NaN for absent ones; the index of the scaling number and its neutral value; the phase.
fn guess(text: &str) -> Guess {
    let mut guess = Guess::at(vec![]);
    for word in text.split_whitespace() {
        if let Some((place, value)) = word.strip_prefix('n').and_then(|rest| rest.split_once('=')) {
            guess.neutral = Some((place.parse().expect("a place"), number(value)));
        } else if let Some(place) = word.strip_prefix('p') {
            guess.phase = Some(place.parse().expect("a place"));
        } else {
            guess.values.push(if word == "-" { f64::NAN } else { number(word) });
        }
    }
    guess
}

#[test]
fn every_effect_gives_what_its_equation_gives_by_hand() {
    let cases = include_str!("cases.txt");
    let mut kinds = std::collections::BTreeSet::new();
    for (k, line) in cases.lines().enumerate() {
        let (case, _) = line.split_once('#').unwrap_or((line, ""));
        if case.trim().is_empty() {
            continue;
        }
        let parts: Vec<&str> = case.split('|').map(str::trim).collect();
        let [kind, plant, arguments, hook, given, expected] = parts[..] else { panic!("line {}: six parts", k + 1) };
        let description = effects::of(kind).expect("a kind");
        kinds.insert(description.kind);
        let (_, plant) = crate::equation_plant::first_format().into_iter().find(|(name, _)| *name == plant).expect("a plant");
        let (arguments, given) = (Given::of(arguments), Given::of(given));
        if hook == "guesses" {
            let found = description.guesses.of(&given.survey(plant));
            let expected: Vec<Guess> = expected.split(';').map(guess).collect();
            let alike = |a: &Guess, b: &Guess| {
                all_close(&a.values, &b.values)
                    && a.phase == b.phase
                    && a.neutral.map(|(place, _)| place) == b.neutral.map(|(place, _)| place)
                    && all_close(
                        &a.neutral.iter().map(|it| it.1).collect::<Vec<_>>(),
                        &b.neutral.iter().map(|it| it.1).collect::<Vec<_>>(),
                    )
            };
            let is_same = found.len() == expected.len() && found.iter().zip(&expected).all(|(a, b)| alike(a, b));
            assert!(is_same, "line {}: {line}\nfound {found:?}", k + 1);
            continue;
        }
        let subject = arguments.word("of").map(str::to_owned);
        let effect = (description.build)(&Arguments { plant, subject, numbers: numbers(description, &arguments) });
        let found = found(effect.as_ref(), plant, hook, &given);
        let expected: Vec<f64> = expected.split_whitespace().map(number).collect();
        assert!(all_close(&found, &expected), "line {}: {line}\nfound {found:?}", k + 1);
    }
    let missing: Vec<&str> = effects::ALL.iter().map(|it| it.kind).filter(|kind| !kinds.contains(kind)).collect();
    assert!(missing.is_empty(), "no case for {missing:?}");
}

#[test]
fn an_effect_takes_the_numbers_of_its_plant_and_no_others() {
    let names = |kind: &str, plant| -> Vec<&str> {
        effects::of(kind).expect("a kind").arguments_on(plant).map(|argument| argument.name).collect()
    };
    // The stiffness of a car's shaft is a parameter of the plant. The drive of an axis is rigid, so the effect needs the stiffness and damping of the
    // contact.
    assert_eq!(names("backlash", crate::equation_plant::driveline()), ["gap"]);
    assert_eq!(names("backlash", crate::equation_plant::servo_axis()), ["gap", "mass_ratio", "stiffness", "damping"]);
    // A number without a plant is valid on each plant.
    for (_, plant) in crate::equation_plant::first_format() {
        assert_eq!(names("sensor-bias", plant), ["bias"]);
    }
}

/// An effect without hooks.
struct Nothing;

impl Effect for Nothing {}

#[test]
fn what_an_effect_has_no_hook_for_it_leaves_as_it_is() {
    let given = Given::of("position=3 speed=5 viscous_friction=7");
    let (before, mut parameters) = (given.survey(pmac()).parameters, given.survey(pmac()).parameters);
    Nothing.parameters(&mut parameters);
    assert_eq!(format!("{parameters:?}"), format!("{before:?}"));
    assert_eq!([Nothing.input(24.0), Nothing.delay(), Nothing.reads_late(1)], [24.0, 0.0, 0.0]);
    assert_eq!((Nothing.acts_between_rows(), Nothing.states(), Nothing.has_pieces()), (true, 0, false));
    let mut own = [3.0, 4.0];
    Nothing.start(&FirstInstant { motion: given.motion(), road_speed: 9.0, time: 7.0 }, &mut own);
    Nothing.settle(&[1.0, 2.0, 3.0], &mut own);
    assert_eq!(own, [3.0, 4.0]);
    let scale = Given::of("slowest=2 change=3").scale();
    assert_eq!([Nothing.fastest_rate(&scale), Nothing.nonlinear_rate(&scale), Nothing.frame_angle(2.0)], [0.0; 3]);
    assert_eq!([Nothing.voltage_limit([2.0, 3.0]), Nothing.voltage_loss([2.0, 3.0], [4.0, 5.0])], [[2.0, 3.0]; 2]);
    let mut machine = Machine { resistance: 2.0, inductance: 3.0, flux_linkage: 4.0 };
    Nothing.machine(&Currents { i_d: 5.0, i_q: 6.0, theta_e: 7.0 }, &[], &mut [], &mut machine);
    assert_eq!([machine.resistance, machine.inductance, machine.flux_linkage], [2.0, 3.0, 4.0]);
    assert_eq!([Nothing.effort(&given.motion()), Nothing.load(&[], &mut []), Nothing.slack(Joint::Clutch)], [0.0; 3]);
    assert_eq!((Nothing.split(), Nothing.vehicle_speed(&[])), (None, None));
    let Motion { position, speed, viscous_friction } = Nothing.far_motion(&[]);
    assert_eq!([position, speed, viscous_friction], [0.0; 3]);
    let twist = Twist { joint: Joint::Clutch, angle: 2.0, rate: 3.0, stiffness: 4.0, damping: 5.0 };
    let body = Split { near: given.motion(), inertia: 8.0, load: 6.0, held: Some(2) };
    let carried = [
        Nothing.passes(&body, &[], &mut []),
        Nothing.joint(&twist, 6.0, Some(2)),
        Nothing.joint_limit(Joint::Clutch, 6.0, Some(2)),
    ];
    assert!(carried.iter().all(|Carried { effort, piece }| (*effort, *piece) == (6.0, 0)));
    assert_eq!([Nothing.engine_torque(5.0, 6.0), Nothing.air_speed(7.0)], [5.0, 7.0]);
    assert_eq!(Nothing.traction(&Contact { surface_speed: 2.0, resistance: 3.0, mass: 4.0 }, &[], &mut []), None);
    assert_eq!([Nothing.reads(1, 8.0, 2.0, &[], &mut []), Nothing.truth(1, 9.0, 2.0)], [8.0, 9.0]);
    assert!(!Nothing.reads_with_memory());
}

/// An effect that has only a rate.
struct Fast;

impl Effect for Fast {
    fn fastest_rate(&self, scale: &Scale) -> f64 {
        7.0 * scale.inertia
    }
}

#[test]
fn an_effect_that_says_nothing_of_its_linear_part_leaves_all_of_its_rate() {
    assert_eq!(Fast.nonlinear_rate(&Given::of("inertia=3").scale()), 21.0);
}

#[test]
fn the_rate_of_a_smooth_sign_is_its_slope_or_its_passing() {
    // Level 12, inertia 6, width 0.5: the rate is 12/0.5/6 = 4 at rest, and 1 - tanh^2 0.5 times this value at a speed of 0.25.
    let rate = |given: &str| smooth_sign_rate(12.0, 0.5, &Given::of(given).scale());
    assert_eq!(rate(""), 4.0);
    assert!(close(rate("slowest=0.25"), 4.0 * (1.0 - 0.5f64.tanh().powi(2))));
    // The speed changes by 18 per second: the rate of passing is 18/0.5 = 36, and sqrt(4 * 36) = 12.
    assert!(close(rate("change=18"), 12.0));
}

#[test]
fn a_scale_of_bodies_alone_has_no_windings_and_no_vehicle_that_move() {
    let scale = Scale::of(8.0, 6.0, (-5.0, -2.0), 0.5);
    assert_eq!([scale.inertia, scale.drive_inertia, scale.slowest, scale.change], [8.0, 6.0, 4.0, 2.0]);
    assert_eq!(Scale::of(8.0, 6.0, (1.0, 4.0), 0.5).slowest, 0.0);
    let Windings { inductance, decay, swing, turning, current, change } = scale.windings;
    assert_eq!([inductance, decay, swing, turning, current.0, current.1, change], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let Vehicle { wheel, speed, crank_speed, clutch_mobility, clutch, swing } = scale.vehicle;
    assert_eq!([wheel, swing], [(1.0, 1.0); 2]);
    assert_eq!(([speed, crank_speed, clutch_mobility], clutch), ([0.0, 0.0, 1.0], (1.0, 0.0, 0.0)));
}

/// Values for the first three outputs, and the default for all others.
fn of_outputs<T: Copy + Default>(first: [T; 3]) -> [T; OUTPUTS] {
    crate::kind::by_output(&first, T::default())
}
