//! One case: inputs, design, the true response, the hidden causes with their magnitudes, the noise, the nominal file.
//!
//! In: a seed, a name, the causes to hide. Out: [`Case`]. Every effect changes the response by one to four standard deviations of the noise, as a
//! root mean square. It never uses an answer.

use super::files::{model_file, table, term_name};
use super::polynomial::{Input, Powers, fit, monomial, up_to, value};
use super::{Case, Hidden, Truth};
use crate::random::Random;

pub(super) const NAMES: [(&str, &str, f64, f64); 5] = [
    ("torque", "N*m", 0.0, 21.6),
    ("speed", "rad/s", 50.0, 800.0),
    ("current", "A", -30.0, 40.0),
    ("pressure", "bar", 1.0, 9.0),
    ("angle", "deg", -20.0, 35.0),
];

/// A design in coded inputs: random points, a grid with replicates, or a composite design with centre points, in random order.
pub(super) fn design(random: &mut Random, inputs: usize, rows: usize) -> Vec<Vec<f64>> {
    let kind = random.whole(0, 2);
    let mut points: Vec<Vec<f64>> = match kind {
        0 => (0..rows).map(|_| (0..inputs).map(|_| random.uniform(-1.0, 1.0)).collect()).collect(),
        1 => {
            let levels = if inputs == 2 { 5 } else { 3 };
            let cell = |k: usize| {
                (0..inputs)
                    .map(|i| (k / levels_to(levels, i)) % levels)
                    .map(|l| 2.0 * l as f64 / (levels - 1) as f64 - 1.0)
                    .collect()
            };
            (0..rows).map(cell).collect()
        }
        _ => (0..rows)
            .map(|k| {
                let corners = 1 << inputs;
                let place = k % (corners + 2 * inputs + 3);
                (0..inputs)
                    .map(|i| {
                        if place < corners {
                            if place >> i & 1 == 1 { 1.0 } else { -1.0 }
                        } else if place < corners + 2 * inputs {
                            let axis = place - corners;
                            if axis / 2 == i { if axis % 2 == 1 { 1.0 } else { -1.0 } } else { 0.0 }
                        } else {
                            0.0
                        }
                    })
                    .collect()
            })
            .collect(),
    };
    for last in (1..points.len()).rev() {
        points.swap(last, random.whole(0, last as u64) as usize);
    }
    points
}

fn levels_to(levels: usize, power: usize) -> usize {
    (0..power).fold(1, |product, _| product * levels)
}

pub(super) fn root_mean_square(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count().max(1) as f64;
    (values.map(|x| x * x).sum::<f64>() / count).sqrt()
}

/// The whole truth about one case.
struct World {
    inputs: Vec<Input>,
    truth: Vec<(Powers, f64)>,
    extra: Option<(Input, Vec<(Powers, f64)>)>,
    /// (gain, bias) of the response's sensor.
    response: (f64, f64),
    /// (input, gain, bias).
    sensor: Option<(usize, f64, f64)>,
    outside: Option<(u64, usize, f64, f64)>,
}

impl World {
    /// The true response at coded inputs; z is the coded additional column.
    fn response(&self, x: &[f64], z: f64) -> f64 {
        let mut y = value(&self.truth, x);
        if let Some((_, terms)) = &self.extra {
            y += terms.iter().map(|(powers, c)| c * z * monomial(powers, x)).sum::<f64>();
        }
        if let Some((kind, input, amount, at)) = self.outside {
            y += amount
                * match kind {
                    0 => (9.0 * x[input] + at).sin(),
                    1 => 2.0 * ((x[input] - 0.4 * at.sin()).abs() * 3.0).min(1.0),
                    _ => 2.5 * (-x.iter().map(|x| (x - 0.4 * at.sin()).powi(2)).sum::<f64>() / 0.3).exp(),
                };
        }
        y
    }

    /// The readings for a true point.
    fn read(&self, x: &[f64]) -> Vec<f64> {
        let mut natural: Vec<f64> = self.inputs.iter().zip(x).map(|(input, x)| input.natural(*x)).collect();
        if let Some((input, gain, bias)) = self.sensor {
            natural[input] = gain * natural[input] + bias;
        }
        natural
    }
}

/// The case of a name with these hidden causes.
pub fn make(seed: u64, name: &str, hidden: &[Hidden]) -> Case {
    let random = &mut Random::new(seed, name);
    let has = |it: Hidden| hidden.contains(&it);
    let count = random.whole(2, 3) as usize;
    let first = random.whole(0, 4) as usize;
    let inputs: Vec<Input> = (0..count)
        .map(|k| NAMES[(first + k) % NAMES.len()])
        .map(|(name, unit, low, high)| Input { name, unit, range: [low, high] })
        .collect();
    let order = random.whole(1, if count == 2 { 3 } else { 2 }) as u32;
    // Sensor errors of inputs are visible only with curvature or with several slopes.
    let order = if has(Hidden::InputGain) || has(Hidden::InputBias) { order.max(2) } else { order };
    let mut powers = up_to(count, order);
    let scale = random.spread(0.5, 200.0);
    let mut truth: Vec<(Powers, f64)> = powers
        .iter()
        .map(|powers| {
            let order = powers.iter().sum::<u32>();
            let size =
                if order == 0 { random.uniform(3.0, 6.0) } else { random.sign() * random.uniform(0.4, 1.2) / f64::from(order) };
            (powers.clone(), scale * size)
        })
        .collect();
    let large = has(Hidden::GrowingNoise) || has(Hidden::Following) || hidden.len() > 1;
    let rows = if large { random.whole(70, 140) } else { random.whole(40, 120) } as usize;
    let points = design(random, count, rows);
    let spread = root_mean_square(points.iter().map(|x| value(&truth[1..], x)));
    let sigma = spread * random.uniform(0.01, 0.05);
    // The effect of each hidden cause on the response, as a root mean square.
    let strength = |random: &mut Random| sigma * random.spread(1.0, 4.0);
    let mut truths = Vec::new();
    let mut world =
        World { inputs: inputs.clone(), truth: Vec::new(), extra: None, response: (1.0, 0.0), sensor: None, outside: None };
    let mut missing: Option<(Powers, f64)> = None;
    let mut missing_before = false;
    if has(Hidden::MissingTerm) {
        let within = order >= 2 && random.whole(0, 1) == 1;
        let of_order = |order: u32| up_to(count, order).into_iter().filter(move |powers| powers.iter().sum::<u32>() == order);
        let candidates: Vec<Powers> = of_order(if within { order } else { order + 1 }).collect();
        // A square or a cube needs a sufficient number of levels. The composite design has them only up to the second power.
        let visible: Vec<&Powers> = candidates.iter().filter(|powers| powers.iter().all(|power| *power <= 2)).collect();
        let chosen = visible[random.whole(0, visible.len() as u64 - 1) as usize].clone();
        let size = root_mean_square(points.iter().map(|x| monomial(&chosen, x)));
        let mean = points.iter().map(|x| monomial(&chosen, x)).sum::<f64>() / rows as f64;
        let own = (size * size - mean * mean).sqrt();
        let coefficient = random.sign() * strength(random) / own.max(0.3 * size);
        powers.retain(|powers| *powers != chosen);
        truth.retain(|(powers, _)| *powers != chosen);
        missing_before = random.whole(0, 1) == 1;
        let label = format!("missing-term:{}", term_name(&inputs, &chosen));
        truths.push(Truth { label, number: Some(("coefficient", coefficient)) });
        missing = Some((chosen, coefficient));
    }
    world.truth = truth.clone();
    world.truth.extend(missing.clone());
    // The nominal file.
    let fitted = random.whole(0, 1) == 1 || missing_before;
    let rows_of_file = (powers.len() * 3).max(30) + random.whole(0, 60) as usize;
    let mut residual_sd = 0.0;
    let nominal: Vec<(Powers, f64)> = if fitted {
        let old: Vec<Vec<f64>> = (0..rows_of_file).map(|_| (0..count).map(|_| random.uniform(-1.0, 1.0)).collect()).collect();
        let base = if missing_before { &world.truth } else { &truth };
        let y: Vec<f64> = old.iter().map(|x| value(base, x) + sigma * random.normal()).collect();
        let found: Vec<(Powers, f64)> = powers.iter().cloned().zip(fit(&powers, &old, &y)).collect();
        let square: f64 = old.iter().zip(&y).map(|(x, y)| (y - value(&found, x)).powi(2)).sum();
        residual_sd = (square / (rows_of_file - powers.len()) as f64).sqrt();
        found
    } else {
        truth.clone()
    };
    let evidence = fitted.then_some((rows_of_file, residual_sd));
    // Additional columns: one that may have an effect, one with blocks.
    let temperature = Input { name: "temperature", unit: "degC", range: [15.0, 45.0] };
    let z: Vec<f64> = (0..rows).map(|_| random.uniform(-1.0, 1.0)).collect();
    let with_extra = has(Hidden::MissingInput) || random.whole(0, 1) == 1;
    if has(Hidden::MissingInput) {
        let amount = random.sign() * strength(random) / 0.577;
        let mut terms = vec![(vec![0; count], amount)];
        if random.whole(0, 2) == 0 {
            let mut with = vec![0; count];
            with[random.whole(0, count as u64 - 1) as usize] = 1;
            terms.push((with, random.sign() * strength(random) / 0.4));
        }
        truths.push(Truth { label: "missing-input:temperature".into(), number: Some(("slope", amount / 15.0)) });
        world.extra = Some((temperature.clone(), terms));
    }
    let levels = random.whole(2, 4) as usize;
    let with_blocks = has(Hidden::Blocks) || random.whole(0, 1) == 1;
    let offsets: Vec<f64> = if has(Hidden::Blocks) {
        let size = strength(random);
        // Offsets that differ by construction: at least two differ by twice the size.
        let mut offsets: Vec<f64> =
            (0..levels).map(|k| size * (if k % 2 == 0 { -1.0 } else { 1.0 } + random.uniform(-0.3, 0.3))).collect();
        if random.whole(0, 1) == 1 {
            let first = offsets[0];
            offsets.iter_mut().for_each(|x| *x -= first);
        }
        truths.push(Truth { label: "block-offset:block".into(), number: None });
        offsets
    } else {
        vec![0.0; levels]
    };
    // Blocks in the run order, or mixed.
    let mixed = random.whole(0, 1) == 1;
    let block_of: Vec<usize> =
        (0..rows).map(|k| if mixed { random.whole(0, levels as u64 - 1) as usize } else { k * levels / rows }).collect();
    if has(Hidden::ResponseGain) {
        let gain = 1.0
            + random.sign() * (strength(random) / (spread * spread + (truth[0].1).powi(2)).sqrt()).max(1.5 * sigma / spread);
        world.response.0 = gain;
        truths.push(Truth { label: "sensor-gain:y".into(), number: Some(("gain", gain)) });
    }
    if has(Hidden::ResponseBias) {
        let bias = random.sign() * strength(random);
        world.response.1 = bias;
        truths.push(Truth { label: "sensor-bias:y".into(), number: Some(("bias", bias)) });
    }
    if has(Hidden::InputGain) || has(Hidden::InputBias) {
        let input = random.whole(0, count as u64 - 1) as usize;
        let [low, high] = inputs[input].range;
        let sign = random.sign();
        let moved = |gain: f64, bias: f64| {
            root_mean_square(points.iter().map(|x| {
                let mut there = x.clone();
                there[input] = inputs[input].coded(gain * inputs[input].natural(x[input]) + bias);
                value(&truth, &there) - value(&truth, x)
            }))
        };
        let wanted = strength(random);
        if has(Hidden::InputGain) {
            let gain = 1.0 + sign * (0.01 * wanted / moved(1.0 + 0.01 * sign, 0.0)).clamp(0.02, 0.2);
            world.sensor = Some((input, gain, 0.0));
            truths.push(Truth { label: format!("sensor-gain:{}", inputs[input].name), number: Some(("gain", gain)) });
        }
        if has(Hidden::InputBias) {
            let unit = 0.005 * (high - low) * sign;
            let bias = unit * (wanted / moved(1.0, unit)).clamp(2.0, 30.0);
            let gain = world.sensor.map_or(1.0, |it| it.1);
            world.sensor = Some((input, gain, bias));
            truths.push(Truth { label: format!("sensor-bias:{}", inputs[input].name), number: Some(("bias", bias)) });
        }
    }
    if has(Hidden::Outside) {
        let input = random.whole(0, count as u64 - 1) as usize;
        world.outside = Some((random.whole(0, 2), input, 1.0, random.uniform(0.0, 6.0)));
    }
    // The true response.
    let colour = if has(Hidden::Following) { random.uniform(0.55, 0.85) } else { 0.0 };
    let mut noise = random.noise(rows, sigma, colour);
    if has(Hidden::Following) {
        truths.push(Truth { label: "correlated-errors".into(), number: None });
    }
    // Effects outside the catalogue along an axis are visible only if there are points along it.
    let points = if has(Hidden::Outside) {
        (0..rows).map(|_| (0..count).map(|_| random.uniform(-1.0, 1.0)).collect()).collect()
    } else {
        points
    };
    if let Some((kind, input, _, at)) = world.outside {
        // Only the part that no polynomial of the next order can approximate counts.
        let shape: Vec<f64> = points.iter().map(|x| world.response(x, 0.0) - value(&world.truth, x)).collect();
        let imitating = up_to(count, order + 1);
        let coefficients = fit(&imitating, &points, &shape);
        let imitation: Vec<(Powers, f64)> = imitating.into_iter().zip(coefficients).collect();
        let shape = root_mean_square(points.iter().zip(&shape).map(|(x, y)| y - value(&imitation, x)));
        world.outside = Some((kind, input, sigma * random.spread(1.5, 4.0) / shape, at));
    }
    let mut y: Vec<f64> = points.iter().zip(&z).map(|(x, z)| world.response(x, *z)).collect();
    if has(Hidden::GrowingNoise) {
        let (low, high) = y.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), y| (a.min(*y), b.max(*y)));
        let ratio = random.spread(5.0, 15.0);
        for (e, y) in noise.iter_mut().zip(&y) {
            *e *= ratio.powf((y - low) / (high - low) - 0.5);
        }
        truths.push(Truth { label: "growing-noise".into(), number: None });
    }
    let drift = has(Hidden::Drift).then(|| random.sign() * strength(random) / 0.29);
    let step = has(Hidden::Step)
        .then(|| (random.sign() * strength(random) / 0.45, random.whole(rows as u64 / 4, 3 * rows as u64 / 4) as usize));
    if let Some(total) = drift {
        truths.push(Truth { label: "drift".into(), number: Some(("total", total)) });
    }
    if let Some((size, _)) = step {
        truths.push(Truth { label: "drift".into(), number: Some(("step", size)) });
    }
    let centred = random.whole(0, 1) == 1;
    for k in 0..rows {
        y[k] = world.response.0 * y[k] + world.response.1 + noise[k];
        if with_blocks {
            y[k] += offsets[block_of[k]];
        }
        if let Some(total) = drift {
            y[k] += total * (k as f64 / (rows - 1) as f64 - if centred { 0.5 } else { 0.0 });
        }
        if let Some((size, at)) = step
            && k >= at
        {
            y[k] += size;
        }
    }
    if has(Hidden::Outliers) {
        let count = random.whole(1, 4) as usize;
        for _ in 0..count {
            let row = random.whole(0, rows as u64 - 1) as usize;
            y[row] += random.sign() * sigma * random.uniform(8.0, 15.0);
        }
        truths.push(Truth { label: "outlying-runs".into(), number: None });
    }
    let read: Vec<Vec<f64>> = points.iter().map(|x| world.read(x)).collect();
    let data = table(&inputs, &read, &y, with_extra.then_some((&temperature, &z[..])), with_blocks.then_some(&block_of[..]));
    // Unseen rows, from the same sensors, without drift and blocks.
    let unseen_points: Vec<Vec<f64>> = (0..60).map(|_| (0..count).map(|_| random.uniform(-0.9, 0.9)).collect()).collect();
    let unseen_z: Vec<f64> = (0..60).map(|_| random.uniform(-1.0, 1.0)).collect();
    let exact: Vec<f64> =
        unseen_points.iter().zip(&unseen_z).map(|(x, z)| world.response.0 * world.response(x, *z) + world.response.1).collect();
    let measured: Vec<f64> = exact.iter().map(|y| y + sigma * random.normal()).collect();
    let unseen_read: Vec<Vec<f64>> = unseen_points.iter().map(|x| world.read(x)).collect();
    let coded = |natural: &Vec<f64>| inputs.iter().zip(natural).map(|(input, value)| input.coded(*value)).collect::<Vec<f64>>();
    let in_file = hidden.iter().any(|it| {
        use Hidden::*;
        matches!(it, MissingTerm | MissingInput | ResponseGain | ResponseBias | InputGain | InputBias)
    });
    Case {
        name: name.to_string(),
        verdict: if hidden.is_empty() {
            "no-discrepancy"
        } else if has(Hidden::Outside) {
            "unexplained"
        } else {
            "explained"
        },
        truths,
        model: model_file(&inputs, &nominal, evidence),
        data,
        unseen: table(&inputs, &unseen_read, &measured, with_extra.then_some((&temperature, &unseen_z[..])), None),
        nominal: unseen_read.iter().map(|natural| value(&nominal, &coded(natural))).collect(),
        exact,
        in_file,
        fault: None,
    }
}
