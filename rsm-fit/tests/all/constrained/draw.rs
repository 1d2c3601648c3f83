//! Random feasible problems with constraints, from a seed.
//!
//! A constant inside the bounds keeps every constraint here; with a small slope and a small curvature in every direction it keeps them strictly. A
//! response that is odd keeps them with a small slope, because its bounds contain 0. So each problem has a solution, and one that is not on the edge.

use rsm_fit::random::Random;

use super::surface::{Axis, Basis, Entry, Function};

/// A constraint. Inputs by their index.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Asked {
    Bounds(Option<f64>, Option<f64>),
    /// The sign of the slope.
    Monotone(usize, f64),
    /// 1 for convex, -1 for concave.
    Bent(f64),
}

/// A specification and its data.
pub struct Problem {
    pub specification: String,
    pub data: String,
    pub name: String,
    pub basis: Basis,
    pub rows: Vec<(Vec<f64>, f64)>,
    pub asked: Vec<Asked>,
}

/// What is special about a problem.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Family {
    Plain,
    /// The region is that of the data.
    Support,
    Knots,
    Symmetric,
    Reciprocal,
    Sigmoids,
    Waves,
}

const FAMILIES: [Family; 10] = [
    Family::Plain,
    Family::Plain,
    Family::Plain,
    Family::Plain,
    Family::Support,
    Family::Knots,
    Family::Symmetric,
    Family::Reciprocal,
    Family::Sigmoids,
    Family::Waves,
];

/// One of these, by their weights.
fn drawn<T: Copy>(random: &mut Random, items: &[(T, u64)]) -> T {
    let mut place = random.below(items.iter().map(|(_, weight)| weight).sum());
    for (item, weight) in items {
        if place < *weight {
            return *item;
        }
        place -= weight;
    }
    unreachable!("the place is below the sum")
}

/// All powers of so many functions up to an order.
fn powers_up_to(functions: usize, order: u32) -> Vec<Vec<u32>> {
    (0..functions).fold(vec![vec![]], |begun: Vec<Vec<u32>>, _| {
        let longer = |start: &Vec<u32>| {
            let left = order - start.iter().sum::<u32>();
            (0..=left).map(|power| [&start[..], &[power]].concat()).collect::<Vec<_>>()
        };
        begun.iter().flat_map(longer).collect()
    })
}

pub fn problem(seed: u64) -> Problem {
    let mut random = Random::new(seed);
    let family = FAMILIES[(seed % FAMILIES.len() as u64) as usize];
    let mut inputs = drawn(&mut random, &[(1, 25), (2, 35), (3, 25), (4, 15)]);
    let mut order = drawn(&mut random, &[(1, 8), (2, 24), (3, 28), (4, 24), (5, 16)]);
    match family {
        Family::Support => inputs = inputs.max(2),
        Family::Sigmoids | Family::Waves => (inputs, order) = (inputs.min(2), order.min(4)),
        Family::Knots => inputs = inputs.min(3),
        _ => {}
    }
    let is_coded = family != Family::Plain || random.below(3) > 0;
    let mut axes: Vec<Axis> = (0..inputs).map(|_| axis(&mut random, is_coded)).collect();
    let mut functions: Vec<(usize, Function)> = (0..inputs).map(|k| (k, Function::Variable)).collect();
    let mut keys = String::new();
    let name_of = |k: usize| format!("x{k}");
    let own = random.below(inputs as u64) as usize;
    match family {
        Family::Knots => {
            // Two knots are apart, so that rows lie between them.
            let places = drawn(&mut random, &[(&[0.2][..], 1), (&[0.45], 1), (&[0.2, 0.5], 2)]);
            for place in places {
                let [low, high] = axes[own].range;
                functions.push((own, Function::Hinge(low + (place + 0.2 * random.share()) * (high - low))));
            }
            let of = |(_, function): &(usize, Function)| match function {
                Function::Hinge(at) => Some(format!("{{ input = \"{}\", at = {at:?} }}", name_of(own))),
                _ => None,
            };
            keys += &format!("knots = [{}]\n", functions.iter().filter_map(of).collect::<Vec<_>>().join(", "));
        }
        Family::Symmetric => {
            let high = axes[own].range[1].abs().max(0.5);
            let is_even = random.below(2) == 0;
            axes[own] = Axis { range: [-high, high], entry: if is_even { Entry::Even } else { Entry::Odd }, is_coded };
            keys += &format!("symmetry = {{ {} = \"{}\" }}\n", name_of(own), if is_even { "even" } else { "odd" });
        }
        Family::Reciprocal => {
            let low = 0.3 + random.share();
            axes[own] = Axis { range: [low, low * (1.5 + 4.0 * random.share())], entry: Entry::Reciprocal, is_coded };
            keys += &format!("reciprocal = [\"{}\"]\n", name_of(own));
        }
        Family::Sigmoids => {
            let [low, high] = axes[own].range;
            // With rows on both sides: on one side, powers times the sigmoid depend on one another.
            let (at, width) =
                (low + (0.25 + 0.5 * random.share()) * (high - low), (0.03 + 0.3 * random.share()) * (high - low));
            functions.push((own, Function::Sigmoid(at, width)));
            keys += &format!("sigmoids = [{{ input = \"{}\", at = {at:?}, width = {width:?} }}]\n", name_of(own));
        }
        Family::Waves => {
            let turn = std::f64::consts::TAU;
            axes[own] = Axis { range: [0.0, turn], entry: Entry::Plain, is_coded };
            let orders = [1, 2 + random.below(5) as u32];
            for order in orders {
                functions.extend([(own, Function::Cosine(turn, order)), (own, Function::Sine(turn, order))]);
            }
            let of = |order: &u32| format!("{{ input = \"{}\", period = {turn:?}, order = {order} }}", name_of(own));
            keys += &format!("waves = [{}]\n", orders.iter().map(of).collect::<Vec<_>>().join(", "));
        }
        Family::Plain | Family::Support => {}
    }
    let mut terms = powers_up_to(functions.len(), order);
    let is_step = |k: usize| matches!(functions[k].1, Function::Sigmoid(..) | Function::Cosine(..) | Function::Sine(..));
    terms.retain(|powers| {
        let steps: u32 = (0..functions.len()).filter(|k| is_step(*k)).map(|k| powers[k]).sum();
        // x h and h^2 depend on one another, as h = x - knot above it. So a term has one function of the axis with the knots.
        let hinges = (0..functions.len()).filter(|k| functions[*k].0 == own && powers[*k] > 0).count();
        let is_odd = axes[own].entry == Entry::Odd;
        let is_one = family != Family::Knots || hinges <= 1;
        steps <= 1 && is_one && !(is_odd && powers[own] == 0) && !(family == Family::Waves && powers[own] > 0)
    });
    // A set of terms that is not closed under a shift of the variables, but keeps the constant, the slopes and the squares.
    if is_coded && random.below(4) == 0 {
        terms.retain(|powers| {
            let order: u32 = powers.iter().sum();
            order < 2 || powers.contains(&2) && order == 2 || random.below(4) > 0
        });
    }
    let basis = Basis { axes, functions, terms };
    let rows = rows(&mut random, &basis, family);
    let asked = asked(&mut random, &basis, family, order, &rows);
    let mut data = (0..inputs).map(|k| format!("x{k}[1],")).collect::<String>() + "y[1]\n";
    for (x, y) in &rows {
        data += &x.iter().map(|x| format!("{x:e},")).collect::<String>();
        data += &format!("{y:e}\n");
    }
    let words = |asked: &Asked| match *asked {
        Asked::Bounds(min, max) => {
            let key = |name: &str, value: Option<f64>| value.map(|value| format!(", {name} = {value:?}")).unwrap_or_default();
            format!("{{ kind = \"bounds\"{}{} }}", key("min", min), key("max", max))
        }
        Asked::Monotone(input, sign) => {
            let direction = if sign > 0.0 { "increasing" } else { "decreasing" };
            format!("{{ kind = \"monotone\", input = \"x{input}\", direction = \"{direction}\" }}")
        }
        Asked::Bent(sign) => format!("{{ kind = \"{}\" }}", if sign > 0.0 { "convex" } else { "concave" }),
    };
    let constraints = asked.iter().map(words).collect::<Vec<_>>().join(", ");
    let section = |(k, axis): (usize, &Axis)| format!("[inputs.x{k}]\nrange = [{:?}, {:?}]\n", axis.range[0], axis.range[1]);
    let sections: String = basis.axes.iter().enumerate().map(section).collect();
    let list = (0..inputs).map(|k| format!("\"x{k}\"")).collect::<Vec<_>>().join(", ");
    let coding = if is_coded { "range" } else { "none" };
    let support = if family == Family::Support { "support = \"data\"\n" } else { "" };
    let specification = format!(
        "format = 1\nmodel = \"m\"\ndata = [\"data.csv\"]\n{sections}[responses.y]\ninputs = [{list}]\ncoding = \"{coding}\"\n{keys}{support}\
         select = {{ method = \"fixed\" }}\nterms = {:?}\nconstraints = [{constraints}]\n",
        basis.terms
    );
    let name = format!("seed {seed}: {family:?}, {inputs} inputs, order {order}, {} terms, {constraints}", basis.terms.len());
    Problem { specification, data, name, basis, rows, asked }
}

fn axis(random: &mut Random, is_coded: bool) -> Axis {
    // Ranges as speeds, angles and shares have them; plain variables of such a size that a power of 5 has a meaning.
    let range = if is_coded {
        drawn(random, &[([-1.0, 1.0], 3), ([0.0, 6000.0], 1), ([20.0, 120.0], 1), ([0.0, 0.02], 1)])
    } else {
        drawn(random, &[([-1.0, 1.0], 2), ([0.0, 2.0], 1), ([-2.0, 1.0], 1)])
    };
    Axis { range, entry: Entry::Plain, is_coded }
}

/// Rows of a smooth function with noise.
fn rows(random: &mut Random, basis: &Basis, family: Family) -> Vec<(Vec<f64>, f64)> {
    let inputs = basis.axes.len();
    let terms = basis.terms.len();
    let count = terms + 8 + random.below(2 * terms as u64 + 1) as usize;
    let mut normals = || (0..inputs).map(|_| random.normal()).collect::<Vec<f64>>();
    let (slopes, curves, twists) = (normals(), normals(), normals());
    let noise = 10f64.powf(-1.5 + 1.7 * random.share());
    let scale = drawn(random, &[(1.0, 4), (1e3, 1), (1e-3, 1)]);
    let offset = scale * drawn(random, &[(0.0, 3), (2.0, 1), (-20.0, 1)]);
    let is_odd = basis.axes.iter().any(|axis| axis.entry == Entry::Odd);
    let mut rows = Vec::new();
    for _ in 0..count {
        let shared = random.share();
        let mut shares: Vec<f64> = (0..inputs).map(|_| random.share()).collect();
        if family == Family::Support {
            // Along a diagonal, as load and speed of a machine are.
            shares.iter_mut().for_each(|share| *share = (0.6 * shared + 0.4 * *share).clamp(0.0, 1.0));
        }
        let x: Vec<f64> =
            basis.axes.iter().zip(&shares).map(|(axis, s)| axis.range[0] + s * (axis.range[1] - axis.range[0])).collect();
        let t: Vec<f64> = basis
            .axes
            .iter()
            .zip(&x)
            .map(|(axis, x)| {
                let [low, high] = axis.side();
                (2.0 * axis_value(axis, *x) - low - high) / (high - low)
            })
            .collect();
        let smooth: f64 = (0..inputs).map(|k| slopes[k] * t[k] + curves[k] * t[k] * t[k]).sum::<f64>()
            + (1..inputs).map(|k| twists[k] * t[k - 1] * t[k]).sum::<f64>()
            + (2.5 * t[0] + twists[0]).sin();
        let offset = if is_odd { 0.0 } else { offset };
        rows.push((x.clone(), basis.sign(&x) * (offset + scale * (smooth + noise * random.normal()))));
    }
    rows
}

/// The magnitude of an input that enters by it.
fn axis_value(axis: &Axis, x: f64) -> f64 {
    if matches!(axis.entry, Entry::Even | Entry::Odd) { x.abs() } else { x }
}

/// One to three constraints that most rows disagree with somewhere.
fn asked(random: &mut Random, basis: &Basis, family: Family, order: u32, rows: &[(Vec<f64>, f64)]) -> Vec<Asked> {
    let inputs = basis.axes.len();
    let is_odd = basis.axes.iter().any(|axis| axis.entry == Entry::Odd);
    let mut sorted: Vec<f64> = rows.iter().map(|(_, y)| *y).collect();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
    let spread = at(1.0) - at(0.0);
    let mut all = Vec::new();
    if random.below(2) == 0 {
        let (mut low, mut high) = (at(0.3 * random.share()), at(1.0 - 0.3 * random.share()));
        if random.below(6) == 0 {
            // Far off the data.
            (low, high) = (low + 3.0 * spread, high + 3.0 * spread);
        }
        if is_odd {
            (low, high) = (-spread * (0.05 + 0.3 * random.share()), spread * (0.05 + 0.3 * random.share()));
        }
        let bounds = drawn(random, &[((true, true), 2), ((true, false), 1), ((false, true), 1)]);
        // Of few rows, two places may be one.
        let low = low.min(high - 0.05 * spread);
        all.push(Asked::Bounds(bounds.0.then_some(low), bounds.1.then_some(high)));
    }
    for k in 0..inputs {
        let entry = basis.axes[k].entry;
        let may = entry != Entry::Even && (!is_odd || entry == Entry::Odd);
        let is_wave = basis.functions.iter().any(|(axis, function)| *axis == k && matches!(function, Function::Cosine(..)));
        if may && !is_wave && random.below(if k == 0 { 2 } else { 4 }) == 0 {
            all.push(Asked::Monotone(k, if random.below(2) == 0 { 1.0 } else { -1.0 }));
        }
    }
    let may_bend = !matches!(family, Family::Symmetric | Family::Reciprocal | Family::Waves);
    if may_bend && order >= 2 && random.below(3) == 0 {
        all.push(Asked::Bent(if random.below(2) == 0 { 1.0 } else { -1.0 }));
    }
    if all.is_empty() {
        let (low, high) =
            if is_odd { (-0.2 * spread, 0.2 * spread) } else { (at(0.15), at(0.85).max(at(0.15) + 0.05 * spread)) };
        all.push(Asked::Bounds(Some(low), Some(high)));
    }
    random.shuffle(&mut all);
    all.truncate(3);
    all
}
