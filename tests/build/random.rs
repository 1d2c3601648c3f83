//! Random models from a fixed seed, made to be awkward.
//!
//! Out: one model for every number of inputs from 1 to 6 and every order from 1 to 5, then a few more, then models with compensators. Ranges are
//! ordinary, narrow, offset, tiny, huge, symmetric, negative; every option of the model file occurs. Every model passes the check.

use rsm_core::model::{
    Coding, Compensator, HalfSpace, Input, Knot, Model, Outside, Scheduled, Sigmoid, Spline, Surface, Symmetry, Term,
    Transform, Wave,
};

/// More terms say nothing new and take long to compile 14 times.
const MOST_TERMS: usize = 56;

/// Models beyond one for each number of inputs and order.
const EXTRA: usize = 6;

/// Models with compensators.
const COMPENSATORS: usize = 8;

/// Models with splines: of degree 1 and 3, of one, two and three inputs.
const SPLINES: usize = 6;

pub(crate) fn models() -> Vec<Model> {
    let mut random = Random(0x0123_4567_89ab_cdef);
    let shapes = (1..=6).flat_map(|inputs| (1..=5).map(move |order| (inputs, order)));
    let extra = (0..EXTRA).map(|k| (1 + k % 3, 2 + k as u32 % 2));
    let surfaces = shapes.chain(extra).enumerate();
    let mut models: Vec<Model> = surfaces.map(|(index, (inputs, order))| model(&mut random, index, inputs, order)).collect();
    models.extend((0..SPLINES).map(|index| splined(&mut random, index)));
    models.extend(Transform::ALL.iter().enumerate().map(|(index, transform)| transformed(&mut random, index, *transform)));
    models.extend((0..COMPENSATORS).map(|index| compensated(&mut random, index)));
    models
}

/// A model with two compensators: one whose numbers are sums and surfaces, more or fewer of them fixed, and one that is fixed. What its
/// surfaces saturate at keeps the filter stable over the whole box, whatever their terms are.
fn compensated(random: &mut Random, index: usize) -> Model {
    let inputs: Vec<Input> = [("speed", [2.0, 45.0]), ("gear", [1.0, 5.0]), ("slip", [-0.7, 0.7])]
        .into_iter()
        .take(1 + index % 3)
        .map(|(name, range)| {
            let outside = if random.below(3) == 0 { Outside::Extrapolate } else { Outside::Clamp };
            Input { name: name.to_string(), unit: "1".to_string(), range, outside }
        })
        .collect();
    let backwards: Vec<Input> = inputs.iter().rev().cloned().collect();
    let mut of = |name: &str, inputs: &[Input], [low, high]: [f64; 2]| {
        let order = 1 + random.below(3) as u32;
        let mut surface = surface(random, name, inputs.to_vec(), order, Coding::Range);
        surface.support.clear();
        surface.output_range = Some([low, high]);
        for term in &mut surface.terms {
            // Within the limits on most of the box.
            term.coefficient = if term.powers.iter().all(|power| *power == 0) {
                0.5 * (low + high)
            } else {
                (high - low) * random.between(-0.3, 0.3)
            };
        }
        surface
    };
    let surfaces = vec![
        of("frequency", &inputs, [3.0, 300.0]),
        of("damping", &backwards, [0.01, 0.9]),
        of("lack", &inputs[..1], [0.05, 0.7]),
        of("frequency_of_poles", &inputs, [2.0, 200.0]),
    ];
    let surface = |name: &str| Scheduled::Surface(name.to_string());
    let natural_frequency = if index % 4 == 1 { Scheduled::Fixed(random.between(5.0, 100.0)) } else { surface("frequency") };
    let zero_damping = if index % 4 == 2 { Scheduled::Fixed(random.between(0.01, 2.0)) } else { surface("damping") };
    let pole_damping = match index % 4 {
        0 => Scheduled::Sum(vec!["damping".to_string(), "lack".to_string()]),
        1 => Scheduled::Fixed(0.7),
        2 => surface("damping"),
        _ => Scheduled::Sum(vec!["lack".to_string(), "lack".to_string(), "damping".to_string()]),
    };
    let sample_time = [1e-3, 1e-4, 0.004][random.below(3)];
    let pole_frequency = match index % 3 {
        0 => None,
        1 => Some(surface("frequency_of_poles")),
        _ => Some(Scheduled::Fixed(11.0)),
    };
    let name = "tip_in".to_string();
    let scheduled = Compensator { name, sample_time, natural_frequency, zero_damping, pole_damping, pole_frequency };
    let fixed = Compensator {
        name: "k".to_string(),
        sample_time: 0.001,
        natural_frequency: Scheduled::Fixed(random.between(1.0, 1500.0)),
        zero_damping: Scheduled::Fixed(random.between(0.0, 0.3)),
        pole_damping: Scheduled::Fixed(random.between(0.2, 1.5)),
        pole_frequency: (index % 2 == 1).then(|| Scheduled::Fixed(random.between(1.0, 1500.0))),
    };
    Model { name: format!("n{index:02}"), inputs, surfaces, compensators: vec![scheduled, fixed] }
}

/// A model whose terms describe a transform of the response: above 0 in the whole box, or not for those that need not be.
fn transformed(random: &mut Random, index: usize, transform: Transform) -> Model {
    let range = [[0.0, 40.0], [-1.5, 2.5]];
    let outside = |k: usize| if k == 1 && !transform.needs_positive() { Outside::Extrapolate } else { Outside::Clamp };
    let input = |k: usize| Input {
        name: ["speed", "load"][k].to_string(),
        unit: "1".to_string(),
        range: range[k],
        outside: outside(k),
    };
    let inputs: Vec<Input> = (0..1 + index % 2).map(input).collect();
    let mut terms = vec![Term { powers: vec![0; inputs.len()], coefficient: random.between(2.5, 3.5) }];
    for powers in monomials(inputs.len(), 2).into_iter().skip(1) {
        let size = if transform.needs_positive() { 0.4 } else { 1.0 };
        terms.push(Term { powers, coefficient: random.between(-size, size) });
    }
    let surface = Surface {
        name: "s".to_string(),
        unit: "W".to_string(),
        inputs: inputs.iter().map(|input| input.name.clone()).collect(),
        output_range: (index % 3 == 1).then_some([0.2, 30.0]),
        transform: Some(transform),
        terms,
        ..Surface::default()
    };
    Model { name: format!("h{index:02}"), inputs, surfaces: vec![surface], compensators: vec![] }
}

/// A model with one spline; with three inputs the table of a cubic spline would be long, so it has few cells.
fn splined(random: &mut Random, index: usize) -> Model {
    let (count, degree) = ([1, 1, 2, 2, 3, 3][index], [1, 3][index % 2]);
    let ranges = [[-2.5, 7.25], [440.0, 800.0], [-1e-3, 2e-3]];
    // A table in emitted code has another name.
    let names = ["t0", "T1", "i_q"];
    let input =
        |k: usize| Input { name: names[k].to_string(), unit: "1".to_string(), range: ranges[k], outside: Outside::Clamp };
    let inputs: Vec<Input> = (0..count).map(input).collect();
    let cells: Vec<u32> = (0..count).map(|_| 1 + random.below([20, 9, 3][count - 1]) as u32).collect();
    let coefficients: usize = cells.iter().map(|cells| (cells + degree) as usize).product();
    let spline = Spline { degree, cells, coefficients: (0..coefficients).map(|_| coefficient(random, 1.0)).collect() };
    let surface = Surface {
        name: "s".to_string(),
        unit: "A".to_string(),
        inputs: inputs.iter().map(|input| input.name.clone()).collect(),
        output_range: (index == 2).then_some([-1.5, 0.5]),
        spline: Some(spline),
        ..Surface::default()
    };
    Model { name: format!("b{index:02}"), inputs, surfaces: vec![surface], compensators: vec![] }
}

fn model(random: &mut Random, index: usize, inputs: usize, order: u32) -> Model {
    let coding = if index % 7 == 3 { Coding::None } else { Coding::Range };
    let inputs: Vec<Input> = (0..inputs).map(|k| input(random, index, k, coding)).collect();
    let mut surfaces = vec![surface(random, "s", inputs.clone(), order, coding)];
    if index.is_multiple_of(5) {
        // Another surface with the inputs the other way round: the order of its arguments is its own.
        let backwards: Vec<Input> = inputs.iter().rev().take(2).cloned().collect();
        surfaces.push(surface(random, "t", backwards, order, coding));
    }
    Model { name: format!("m{index:02}"), inputs, surfaces, compensators: vec![] }
}

fn input(random: &mut Random, index: usize, k: usize, coding: Coding) -> Input {
    let width = random.between(0.5, 4.0);
    let low = random.between(-3.0, 3.0);
    // With natural powers a huge range would leave nothing but infinities.
    let kind = if coding == Coding::None { random.below(4) } else { random.below(9) };
    let range = match kind {
        0 | 1 => [low, low + width],
        2 => [-width, width],
        3 => [width, 3.0 * width],
        // Narrow and far from 0: f32 has 16 numbers in it.
        4 => [1e6 + 1.0, 1e6 + 2.0],
        5 => [-273.15 - width * 1e-3, -273.15],
        6 => [-3e-12 * width, 1e-12],
        7 => [-4e15, 7e15 * width],
        _ => [0.0, 250.0 * width],
    };
    let outside = if random.below(3) == 0 { Outside::Extrapolate } else { Outside::Clamp };
    let units = ["N*m", "rad/s", "1", "\u{b5}A", "deg", ""];
    let names = ["torque", "speed", "i_q", "Ud", "x", "gear"];
    Input { name: names[k].to_string(), unit: units[(index + k) % units.len()].to_string(), range, outside }
}

fn surface(random: &mut Random, name: &str, inputs: Vec<Input>, order: u32, coding: Coding) -> Surface {
    let mut symmetry = vec![];
    let mut reciprocal = vec![];
    let mut knots: Vec<Knot> = vec![];
    let mut sigmoids: Vec<Sigmoid> = vec![];
    let mut waves: Vec<Wave> = vec![];
    for input in &inputs {
        let [low, high] = input.range;
        let symmetric = low == -high;
        if symmetric && random.below(4) > 0 {
            let odd = random.below(2) == 0;
            symmetry.push((input.name.clone(), if odd { Symmetry::Odd } else { Symmetry::Even }));
        } else if low * high > 0.0 && random.below(3) == 0 {
            reciprocal.push(input.name.clone());
        }
        if random.below(4) == 0 {
            let bottom = if symmetric { 0.0 } else { low };
            knots.push(Knot { input: input.name.clone(), at: bottom + (high - bottom) * random.between(0.2, 0.8) });
        }
        if random.below(4) == 0 && !reciprocal.contains(&input.name) {
            let (at, width) = (low + (high - low) * random.between(-0.2, 1.2), (high - low) * random.between(0.02, 1.0));
            sigmoids.push(Sigmoid { input: input.name.clone(), at, width });
        }
        let is_plain = !reciprocal.contains(&input.name) && !symmetry.iter().any(|(name, _)| *name == input.name);
        if random.below(6) == 0 && is_plain && input.outside == Outside::Clamp {
            // Of order 39 in the fourth power f32 has no bound, since products are enclosed one by one. An exact value of order 8 has 100,000 bits
            // and takes a second. Higher orders are tested in rsm-core, against the cosine.
            let (period, order) = ((high - low) * random.between(1.0, 2.0), 1 + random.below(3) as u32);
            waves.push(Wave { input: input.name.clone(), period, order });
        }
    }
    // Far from 0 the middle of a narrow range may round onto a bound.
    knots.retain(|knot| {
        inputs.iter().all(|input| input.name != knot.input || (input.range[0] < knot.at && knot.at < input.range[1]))
    });
    let scale = [1.0, 1.0, 1e3, 1e-9, 1e12][random.below(5)];
    let odd: Vec<bool> = inputs.iter().map(|input| symmetry.contains(&(input.name.clone(), Symmetry::Odd))).collect();
    let mut powers = monomials(inputs.len() + knots.len() + sigmoids.len() + 2 * waves.len(), order);
    for powers in &mut powers {
        for (k, _) in odd.iter().enumerate().filter(|(_, odd)| **odd) {
            powers[k] = powers[k].max(1);
        }
    }
    powers.sort();
    powers.dedup();
    while powers.len() > MOST_TERMS {
        let victim = random.below(powers.len());
        powers.remove(victim);
    }
    let terms = powers.into_iter().map(|powers| Term { powers, coefficient: coefficient(random, scale) }).collect();
    let output_range = (random.below(3) == 0).then(|| [-0.5 * scale, scale * random.between(0.1, 2.0)]);
    let support = match random.below(3) {
        0 => (0..2)
            .map(|_| HalfSpace { normal: inputs.iter().map(|_| random.between(-1.0, 1.0)).collect(), bound: 0.3 })
            .collect(),
        _ => vec![],
    };
    Surface {
        name: name.to_string(),
        unit: "N*m/A".to_string(),
        inputs: inputs.into_iter().map(|input| input.name).collect(),
        output_range,
        coding,
        symmetry,
        knots,
        sigmoids,
        waves,
        reciprocal,
        terms,
        support,
        ..Surface::default()
    }
}

/// A whole number, or one with all its bits in use; rarely much smaller than the others, as after a fit with too many terms.
fn coefficient(random: &mut Random, scale: f64) -> f64 {
    match random.below(8) {
        0 => 3.0,
        1 => -1.0,
        2 => scale * random.between(-1.0, 1.0) * 1e-7,
        _ => scale * random.between(-2.0, 2.0),
    }
}

/// All powers of `variables` variables whose sum is at most `order`.
fn monomials(variables: usize, order: u32) -> Vec<Vec<u32>> {
    if variables == 0 {
        return vec![vec![]];
    }
    let mut all = vec![];
    for first in 0..=order {
        for mut rest in monomials(variables - 1, order - first) {
            rest.insert(0, first);
            all.push(rest);
        }
    }
    all
}

/// Splitmix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit as u64) as usize
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.next() >> 11) as f64 * 2f64.powi(-53))
    }
}
