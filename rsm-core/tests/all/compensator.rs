//! The compensator: its tape compared with the bilinear transform of H in exact rationals, the behaviour at rest and with an invalid sample, the
//! frequency response, and the certificate with the point that violates it.

use rsm_core::certificate::compensator::{CompensatorCertificate, certify};
use rsm_core::check::Checked;
use rsm_core::compile;
use rsm_core::exact::{self, ideal_step};
use rsm_core::lower;
use rsm_core::number::{Precision, Rational, exact, integer};
use rsm_core::run::Interpreter;
use rsm_core::source::Source;

const HEAD: &str = r#"format = 1
model = "car"

[inputs.speed]
unit = "m/s"
range = [5.0, 45.0]

[inputs.gear]
unit = "1"
range = [1.0, 5.0]

[surfaces.frequency]
unit = "rad/s"
inputs = ["speed", "gear"]
terms = [
  { powers = [0, 0], coefficient = 30.0 },
  { powers = [1, 0], coefficient = 4.0 },
  { powers = [0, 1], coefficient = 12.0 },
]

[surfaces.damping]
unit = "1"
inputs = ["gear"]
terms = [{ powers = [0], coefficient = 0.15 }, { powers = [1], coefficient = 0.05 }]

[surfaces.lack]
unit = "1"
inputs = ["gear", "speed"]
terms = [{ powers = [0, 0], coefficient = 0.5 }, { powers = [1, 1], coefficient = -0.1 }]
"#;

const SCHEDULED: &str = r#"
[compensators.tip_in]
sample_time = 0.001
natural_frequency = { surface = "frequency" }
zero_damping = { surface = "damping" }
pole_damping = { sum = ["damping", "lack"] }
"#;

/// Poles with a separate natural frequency: one tenth of the frequency surface and more, or a number.
const MOVED: &str = r#"
[surfaces.slower]
unit = "rad/s"
inputs = ["gear"]
terms = [{ powers = [0], coefficient = 10.0 }, { powers = [1], coefficient = -3.0 }]

[compensators.tip_in]
sample_time = 0.001
natural_frequency = { surface = "frequency" }
zero_damping = { surface = "damping" }
pole_damping = { sum = ["damping", "lack"] }
pole_frequency = { surface = "slower" }
"#;

const MOVED_FIXED: &str = r#"
[compensators.tip_in]
sample_time = 0.004
natural_frequency = 31.0
zero_damping = 0.11
pole_damping = 0.7
pole_frequency = 9.0
"#;

const FIXED: &str = r#"
[compensators.tip_in]
sample_time = 0.004
natural_frequency = 31.0
zero_damping = 0.11
pole_damping = 0.7
"#;

fn read(compensator: &str) -> Checked {
    Checked::read(&Source::new("car.toml", format!("{HEAD}{compensator}"))).unwrap_or_else(|faults| panic!("{faults}"))
}

/// Signals with steps, a ramp and numbers that are not binary fractions.
fn signal(n: i64) -> Rational {
    integer((n * n) % 7 - 3) / integer(1 + n % 3)
}

/// The difference equation of H with s = (2/T)(q - 1)/(q + 1) and g = w T/2, directly by multiplication: the numerator is
/// (v/w)^2 ((q - 1)^2 + 2 z g (q - 1)(q + 1) + g^2 (q + 1)^2), the denominator has p and v in place of z and w.
fn difference_equation(w: &Rational, z: &Rational, v: &Rational, p: &Rational, sample_time: f64, steps: i64) -> Vec<Rational> {
    let polynomial = |damping: &Rational, frequency: &Rational| {
        let g = frequency * exact(sample_time) / integer(2);
        let (one, square, middle) = (integer(1), &g * &g, integer(2) * damping * &g);
        [&one + &middle + &square, integer(2) * &square - integer(2), &one - &middle + &square]
    };
    let (b, a) = (polynomial(z, w), polynomial(p, v));
    let b = b.map(|coefficient| coefficient * v * v / (w * w));
    let mut y: Vec<Rational> = vec![];
    for n in 0..steps {
        let x = |back: i64| if n >= back { signal(n - back) } else { integer(0) };
        let before = |back: i64| if n >= back { y[(n - back) as usize].clone() } else { integer(0) };
        let sum = &b[0] * x(0) + &b[1] * x(1) + &b[2] * x(2) - &a[1] * before(1) - &a[2] * before(2);
        y.push(sum / &a[0]);
    }
    y
}

#[test]
fn without_rounding_a_step_is_the_bilinear_transform() {
    let steps = 12;
    for precision in Precision::ALL {
        for text in [SCHEDULED, FIXED, MOVED, MOVED_FIXED] {
            let checked = read(text);
            let tape = lower::compensator(&checked, 0, precision);
            println!("{tape}");
            println!("{} operations, {} deep", tape.operation_count(), tape.depth());
            // The schedule is 10 m/s in gear 2.
            let is_scheduled = text == SCHEDULED || text == MOVED;
            let schedule: Vec<Rational> = if is_scheduled { vec![integer(10), integer(2)] } else { vec![] };
            let model = checked.model();
            let of = |name: &str| {
                let surface = model.surface(name).unwrap();
                let at: Vec<Rational> =
                    surface.inputs.iter().map(|input| schedule[usize::from(input == "gear")].clone()).collect();
                exact::value(surface, &checked.inputs_of(surface), &at).unwrap()
            };
            let sample_time = model.compensators[0].sample_time;
            let (w, z, p) = if is_scheduled {
                (of("frequency"), of("damping"), of("damping") + of("lack"))
            } else {
                (exact(31.0), exact(0.11), exact(0.7))
            };
            let v = if text == MOVED { of("slower") } else { w.clone() };
            let v = if text == MOVED_FIXED { integer(9) } else { v };
            let expected = difference_equation(&w, &z, &v, &p, sample_time, steps);
            let mut states = vec![integer(0), integer(0)];
            for (n, expected) in (0..steps).zip(expected) {
                let point: Vec<Rational> = std::iter::once(signal(n)).chain(schedule.iter().cloned()).collect();
                let found = ideal_step(&tape, &mut states, &point).unwrap();
                assert_eq!(found, expected, "step {n}\n{tape}");
            }
        }
    }
}

#[test]
fn a_tape_lists_its_states_and_shares_a_surface_that_is_used_twice() {
    let tape = lower::compensator(&read(SCHEDULED), 0, Precision::F64);
    let listing = tape.to_string();
    assert_eq!(tape.inputs, ["input", "speed", "gear"]);
    assert!(listing.contains("= state s0") && listing.contains("s1   := r"), "{listing}");
    // Each clamp of gear and of speed occurs once: four comparisons, and one that keeps the states if a sample is invalid.
    assert_eq!(listing.matches("= less").count(), 5, "{listing}");
    // A fixed filter: x - s2, times g, plus s1, times 2/denominator (4); y (2), s1 (1), s2 (2); differences that are 0 for finite numbers: one of the
    // argument, added to y (2), two of the sums of the states (4); one less, two selects (3).
    assert_eq!(lower::compensator(&read(FIXED), 0, Precision::F64).operation_count(), 18);
}

#[test]
fn at_rest_the_result_is_the_signal_and_moving_coefficients_move_nothing() {
    fn settled<T: rsm_core::run::Scalar + std::fmt::Debug>(text: &str, of: impl Fn(f64) -> T) {
        let tape = lower::compensator(&read(text), 0, T::PRECISION);
        for level in [1.0, -0.3, 1e-30, 12345.678, 1e30] {
            let mut filter = Interpreter::<T>::new(&tape);
            // The state at rest, exactly: the gain at frequency 0 is exactly 1.
            filter.set_states(&[of(0.0), of(level)]);
            for k in 0..200u32 {
                let (speed, gear) = (5.0 + f64::from(k % 41), 1.0 + f64::from(k / 7 % 5));
                let y = filter.step(&[of(level), of(speed), of(gear)]);
                assert_eq!(y.bits(), of(level).bits(), "{y:?} is not {level}");
                assert_eq!(filter.states()[1].bits(), of(level).bits());
            }
        }
    }
    for text in [SCHEDULED, MOVED] {
        settled::<f64>(text, |value| value);
        settled::<f32>(text, |value| value as f32);
    }
}

#[test]
fn a_step_of_the_signal_settles_at_the_signal() {
    // The slowest poles of this box: w = 14, p = 0.5 (speed 5, gear 1: 0.1 + 0.4), so the envelope decreases with exp(-7 t): after 8 s 5e-25 of it
    // remains, below half a unit in the last place.
    let tape = lower::compensator(&read(SCHEDULED), 0, Precision::F64);
    let mut filter = Interpreter::<f64>::new(&tape);
    let last = (0..8000).map(|_| filter.step(&[0.75, 5.0, 1.0])).last().unwrap();
    // The filter stops when g u no longer changes s2: |g u| <= 2^-54 (half a unit in the last place of 0.75). Then the error of y is at most (p - z)
    // u, with g = 0.007, p - z = 0.4, plus the rounding of y.
    let bound = 0.4 * 2f64.powi(-54) / 0.007 + f64::EPSILON;
    assert!((last - 0.75).abs() <= bound, "{last}");
}

#[test]
fn one_bad_sample_does_not_poison_the_loop() {
    let tape = lower::compensator(&read(SCHEDULED), 0, Precision::F64);
    let mut good = Interpreter::<f64>::new(&tape);
    let mut hit = Interpreter::<f64>::new(&tape);
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    for n in 0..300usize {
        let point = [(n as f64 * 0.05).sin(), 20.0, 2.0 + (n / 100) as f64];
        if n % 10 == 3 {
            let before = hit.states().to_vec();
            let mut worse = point;
            worse[n / 10 % 3] = bad[n / 30 % 3];
            assert!(hit.step(&worse).is_nan(), "{worse:?}");
            assert_eq!(hit.states(), before);
        }
        assert_eq!(good.step(&point).to_bits(), hit.step(&point).to_bits(), "step {n}");
    }
}

#[test]
fn a_state_that_would_overflow_is_held() {
    let tape = lower::compensator(&read(SCHEDULED), 0, Precision::F64);
    let mut filter = Interpreter::<f64>::new(&tape);
    for n in 0..50 {
        let huge = if n % 2 == 0 { f64::MAX } else { -f64::MAX };
        filter.step(&[huge, 20.0, 2.0]);
        assert!(filter.states().iter().all(|state| state.is_finite()), "step {n}");
    }
    assert!(filter.step(&[0.5, 20.0, 2.0]).is_finite());
}

/// H at s = j (2/T) tan(theta/2), the point to which the bilinear transform maps exp(j theta).
fn response(w: f64, z: f64, p: f64, sample_time: f64, theta: f64) -> (f64, f64) {
    let omega = 2.0 / sample_time * (theta / 2.0).tan();
    let part = |damping: f64| (w * w - omega * omega, 2.0 * damping * w * omega);
    let ((a, b), (c, d)) = (part(z), part(p));
    let size = c * c + d * d;
    ((a * c + b * d) / size, (b * c - a * d) / size)
}

#[test]
fn the_frequency_response_is_that_of_the_bilinear_transform() {
    let (w, z, p, sample_time) = (31.0f64, 0.11, 0.7, 0.004);
    let tape = lower::compensator(&read(FIXED), 0, Precision::F64);
    for theta in [0.01, w * sample_time, 0.5, 2.0, 3.0] {
        let (real, imaginary) = response(w, z, p, sample_time, theta);
        let mut filter = Interpreter::<f64>::new(&tape);
        // The transient decreases by exp(-p w T) = 0.917 in each step: after 1000 steps by 1e-37.
        let settled = 1000;
        for n in 0..settled + 200 {
            let angle = theta * f64::from(n);
            let found = filter.step(&[angle.cos()]);
            let expected = real * angle.cos() - imaginary * angle.sin();
            // Rounding: at most 12 roundings per step of numbers below 4 (half a unit, 2^-53 of each). The error of a step decreases by 0.917 in each
            // further step, so the errors of 1/(1 - 0.917) = 12 steps add up. Then 4 roundings for `expected`, whose angle of up to 3600 has two
            // roundings of 2e-13 (half a unit, of 2^12 2^-52).
            let bound = 12.0 * 4.0 * 2f64.powi(-53) * 12.0 + 2.0 * 2.3e-13 + 4.0 * 2f64.powi(-53);
            assert!(n < settled || (found - expected).abs() <= 2.0 * bound, "theta {theta}, step {n}: {found} {expected}");
        }
    }
}

fn certificate(text: &str) -> CompensatorCertificate {
    certify(&read(text), 0)
}

#[test]
fn a_sound_compensator_is_certified() {
    let found = certificate(SCHEDULED);
    assert_eq!(found.violations, []);
    // The range of 30 -+ 4 -+ 12, by hand.
    assert!(found.natural_frequency.low <= 14.0 && found.natural_frequency.low > 14.0 - 1e-9);
    assert!(found.natural_frequency.high >= 46.0 && found.natural_frequency.high < 46.0 + 1e-9);
    // The sum as one polynomial: 0.65 + 0.05 g - 0.1 g v has the values 0.6 at g = v = 1 and 0.5 at g = -1, v = -1.
    assert!(found.pole_damping.low <= 0.5 && found.pole_damping.low > 0.5 - 1e-9, "{:?}", found.pole_damping);
    // The ranges of the summands alone would give 0.1 + 0.4 = 0.5 and 0.2 + 0.6 = 0.8; the sum reaches 0.7 + 0.1 = 0.8 at g = 1, v = -1.
    assert!(found.pole_damping.high >= 0.8 && found.pole_damping.high < 0.8 + 1e-9);
    assert_eq!(found.pole_frequency, None);
    let own = certificate(MOVED).pole_frequency.expect("it has a pole frequency");
    // The range of 10 -+ 3.
    assert!(own.low <= 7.0 && own.low > 7.0 - 1e-9 && own.high >= 13.0 && own.high < 13.0 + 1e-9, "{own:?}");
}

#[test]
fn the_published_surface_32_is_refused_with_the_corner_of_high_speed_and_low_gear() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../generated/coefficients");
    let published = std::fs::read_to_string(folder.join("throttle.toml")).unwrap();
    let text = published
        + "\n[compensators.tip_in]\nsample_time = 0.001\nnatural_frequency = 20.0\nzero_damping = { surface = \"damping_ratio\" }\n\
           pole_damping = 0.7\n";
    let source = Source::new("throttle.toml", text);
    let checked = Checked::read(&source).unwrap();
    let found = certify(&checked, 0);
    assert_eq!(found.violations.len(), 1);
    let violation = &found.violations[0];
    assert_eq!(violation.key, "zero_damping");
    assert_eq!(violation.at, [("speed".to_string(), 70.0), ("gear".to_string(), 1.0)]);
    let faults = compile::rust(&source, &[]).unwrap_err().to_string();
    let expected = "compensator `tip_in`: `zero_damping`: found -0.7559 at speed = 70, gear = 1, expected more than 0";
    assert!(faults.contains(expected) && faults.starts_with("throttle.toml:40:16: "), "{faults}");
}

#[test]
fn what_breaks_a_condition_is_named_with_its_point() {
    let cases = [
        // The frequency is 46 rad/s at 45 m/s in gear 5; a quarter of the sample rate is pi/(2 0.05) = 31.4159.
        (
            "sample_time = 0.05\nnatural_frequency = { surface = \"frequency\" }\nzero_damping = 0.1\npole_damping = 0.7\n",
            "natural_frequency",
            "found 46 at speed = 45, gear = 5, expected less than a quarter of the sample rate, 31.4159 rad/s",
        ),
        (
            "sample_time = 0.05\nnatural_frequency = 40.0\nzero_damping = 0.1\npole_damping = 0.7\n",
            "natural_frequency",
            "found 40, expected less than a quarter of the sample rate, 31.4159 rad/s",
        ),
        // The same rule applies to the separate frequency of the poles: 13 rad/s in gear 1 (10 + 3).
        (
            "sample_time = 0.125\nnatural_frequency = 10.0\nzero_damping = 0.1\npole_damping = 0.7\npole_frequency = { surface = \"slower\" }\n",
            "pole_frequency",
            "found 13 at gear = 1, expected less than a quarter of the sample rate, 12.5664 rad/s",
        ),
        // The smallest value of `falls` is inside the box, at speed 25 (coded 0): -0.01.
        (
            "sample_time = 0.001\nnatural_frequency = 20.0\nzero_damping = { surface = \"falls\" }\npole_damping = 0.7\n",
            "zero_damping",
            "found -0.01 at speed = 25, expected more than 0",
        ),
        // The sum of a surface with itself, saturated: from -0.02.
        (
            "sample_time = 0.001\nnatural_frequency = 20.0\nzero_damping = 0.1\npole_damping = { sum = [\"held\", \"falls\"] }\n",
            "pole_damping",
            "found -0.005 at speed = 25, expected more than 0",
        ),
    ];
    let extra = "\n[surfaces.slower]\nunit = \"rad/s\"\ninputs = [\"gear\"]\nterms = [{ powers = [0], coefficient = 10.0 }, { powers = [1], coefficient = -3.0 }]\n\
                 \n[surfaces.falls]\nunit = \"1\"\ninputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = -0.01 }, { powers = [2], coefficient = 0.3 }]\n\
                 \n[surfaces.held]\nunit = \"1\"\ninputs = [\"speed\"]\noutput_range = [0.005, 1.0]\nterms = [{ powers = [0], coefficient = -0.01 }, { powers = [2], coefficient = 0.3 }]\n";
    for (text, key, what) in cases {
        let found = certificate(&format!("{extra}\n[compensators.k]\n{text}")).violations;
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((found[0].key, found[0].what.as_str()), (key, what));
    }
}

#[test]
fn what_cannot_be_decided_is_said_to_be_uncertain() {
    // One surface is held at 0.05 where the other is 0.06, and is 0.5 where the other is -0.06. The sum is never below 0.11, but the ranges add up to
    // [-0.01, 0.56].
    let text = "\n[surfaces.up]\nunit = \"1\"\ninputs = [\"speed\"]\noutput_range = [0.05, 1.0]\nterms = [{ powers = [1], coefficient = 0.5 }]\n\
                \n[surfaces.down]\nunit = \"1\"\ninputs = [\"speed\"]\nterms = [{ powers = [1], coefficient = -0.06 }]\n\
                \n[compensators.k]\nsample_time = 0.001\nnatural_frequency = 20.0\nzero_damping = 0.1\npole_damping = { sum = [\"up\", \"down\"] }\n";
    let found = certificate(text).violations;
    assert_eq!(found.len(), 1);
    assert!(
        found[0].what.starts_with(
            "not certain to be more than 0: its enclosure is [-0.01, 0.56], the worst value found 0.11 at speed = 5"
        ),
        "{found:?}"
    );
}

#[test]
fn a_fixed_number_that_f32_cannot_hold_is_refused_for_f32_alone() {
    let checked = read(&FIXED.replace("0.7", "1e38"));
    assert!(checked.refusal(Precision::F64).is_none());
    let said = checked.refusal(Precision::F32).expect("4e38 is infinite in f32").to_string();
    assert!(said.contains("compensator `tip_in`: `pole_damping`: 1e38 is too large or too small for f32"), "{said}");
}

/// Numbers below and above pi, from its digits.
fn around_pi() -> (Rational, Rational) {
    let ten_digits = integer(10i64.pow(10));
    let below = integer(3_141_592_653) * &ten_digits + integer(5_897_932_384);
    let scale = &ten_digits * integer(10i64.pow(9));
    (&below / &scale, (&below + integer(1)) / &scale)
}

/// The keys of the violations of a compensator with fixed numbers; `refused` if the file is refused.
fn keys_of_violations(numbers: [f64; 4], sample_time: f64) -> Vec<&'static str> {
    let [w, z, p, v] = numbers;
    let text = format!(
        "\n[compensators.k]\nsample_time = {sample_time:?}\nnatural_frequency = {w:?}\nzero_damping = {z:?}\npole_damping = {p:?}\n\
         pole_frequency = {v:?}\n"
    );
    match Checked::read(&Source::new("car.toml", format!("{HEAD}{text}"))) {
        Ok(checked) => certify(&checked, 0).violations.iter().map(|violation| violation.key).collect(),
        Err(_) => vec!["refused"],
    }
}

#[test]
fn the_limits_of_stability_are_exact() {
    let sound = [10.0, 0.1, 0.7, 9.0];
    assert_eq!(keys_of_violations(sound, 0.001), [""; 0]);
    let keys = ["natural_frequency", "zero_damping", "pole_damping", "pole_frequency"];
    let (pi_below, pi_above) = around_pi();
    for (part, key) in keys.into_iter().enumerate() {
        let with = |value: f64| {
            let mut numbers = sound;
            numbers[part] = value;
            numbers
        };
        // Any value above 0 is accepted: the square of 1e100 is still a finite number.
        assert_eq!(keys_of_violations(with(1e-100), 0.001), [""; 0]);
        for low in [0.0, -0.0, -1e-100, -1e-9, -1e-3, -1.0] {
            // Fixed numbers are refused when the file is checked.
            assert_eq!(keys_of_violations(with(low), 0.001), ["refused"], "{low}");
        }
        // A frequency must be below a quarter of the sample rate, 2 pi/(4 T). Four numbers below this limit is tested as the nearest.
        for sample_time in [0.001, 0.004, 0.1, 1.0 / 7.0] {
            let quarter = (&pi_below / exact(sample_time) / integer(2), &pi_above / exact(sample_time) / integer(2));
            let last_below = Precision::F64.round_down(&quarter.0);
            let near = (0..4).fold(last_below, |number, _| number.next_down());
            let is_frequency = key.ends_with("_frequency");
            assert_eq!(keys_of_violations(with(near), sample_time), [""; 0]);
            let beyond = Precision::F64.round_up(&quarter.1);
            for high in [beyond, beyond * 1.02, beyond * 2.0] {
                let expected: &[&str] = if is_frequency { &[key] } else { &[] };
                assert_eq!(keys_of_violations(with(high), sample_time), expected, "{key} {high} {sample_time}");
            }
        }
    }
}

#[test]
fn a_surface_just_inside_the_limits_passes_and_one_just_outside_is_refused() {
    // A frequency that goes from `end` at gear 1 to `other` at gear 5: the end determines the result. A relative distance of 1e-9 is more than the
    // width of any enclosure.
    let quarter = 2.0 * std::f64::consts::PI / (4.0 * 0.01);
    let cases = [
        ("natural_frequency", quarter * (1.0 - 1e-9), 20.0, true),
        ("natural_frequency", quarter * (1.0 + 1e-9), 20.0, false),
        ("natural_frequency", 1e-9, 20.0, true),
        ("natural_frequency", -1e-9, 20.0, false),
        ("zero_damping", 1e-9, 0.5, true),
        ("zero_damping", -1e-9, 0.5, false),
        ("pole_damping", 1e-9, 0.5, true),
        ("pole_damping", -1e-9, 0.5, false),
        ("pole_damping", 1e9, 0.5, true),
        ("pole_frequency", quarter * (1.0 - 1e-9), 20.0, true),
        ("pole_frequency", quarter * (1.0 + 1e-9), 20.0, false),
        ("pole_frequency", 1e-9, 20.0, true),
        ("pole_frequency", -1e-9, 20.0, false),
    ];
    for (key, end, other, is_sound) in cases {
        for (from, to) in [(end, other), (other, end)] {
            let (middle, half) = ((from + to) / 2.0, (to - from) / 2.0);
            let mut parts =
                [("natural_frequency", "9.0"), ("zero_damping", "0.1"), ("pole_damping", "0.7"), ("pole_frequency", "8.0")];
            parts.iter_mut().filter(|part| part.0 == key).for_each(|part| part.1 = "{ surface = \"edge\" }");
            let parts: String = parts.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
            let text = format!(
                "\n[surfaces.edge]\nunit = \"1\"\ninputs = [\"gear\"]\n\
                 terms = [{{ powers = [0], coefficient = {middle:?} }}, {{ powers = [1], coefficient = {half:?} }}]\n\
                 \n[compensators.k]\nsample_time = 0.01\n{parts}"
            );
            let found = certificate(&text).violations;
            assert_eq!(found.is_empty(), is_sound, "{key} from {from} to {to}: {found:?}");
            if let Some(violation) = found.first() {
                let gear = if from == end { 1.0 } else { 5.0 };
                assert_eq!((violation.key, violation.at.as_slice()), (key, [("gear".to_string(), gear)].as_slice()));
                assert!(violation.what.starts_with("found "), "{violation:?}");
            }
        }
    }
}
