//! The possible faults of a surface and of its data: one hypothesis for each cause and shape.
//!
//! In: a [`Sample`]. Out: the list of [`Hypothesis`] values. Each has its columns (what it adds to the response, one column for each unknown) and the
//! terms that it would write into the model file. A cause has several shapes if only the data can decide between them: a missing term that the old
//! fit partly absorbed into its coefficients, or a sensor gain of 0.8 or 1.2. The response is not used.

use super::sample::Sample;
use crate::engine::columns::{Basis, dot, solve, subtract};
use rsm_fit::design::{self, missing_odd_input, terms_up_to};

/// A product of powers of the surface's factors and of a column that the surface does not have.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Monomial {
    /// The powers of the surface's factors.
    pub powers: Vec<u32>,
    /// The extra column and its power.
    pub extra: Option<(usize, u32)>,
}

/// The missing part of an extra column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Proportional to it.
    Linear,
    /// Its square.
    Square,
    /// Its product with an input of the surface.
    With(usize),
}

/// The kind of a hypothesis: what is missing or wrong.
#[derive(Debug, Clone, PartialEq)]
pub enum HypothesisKind {
    /// A term that the file does not have.
    Term(Vec<u32>),
    /// All terms of the next order, and those missing below it: many small ones, of which none is significant alone.
    Order(u32),
    /// Another coefficient of a term that it has.
    Coefficient(usize),
    /// Other coefficients of all terms that it has.
    Refit,
    /// An extra column acts on the response.
    Input(usize, Part),
    /// The response changes steadily with the run order, or with an extra column that rises with it.
    Drift(Option<usize>),
    /// The response has different values before a row and from that row on.
    Step(usize),
    /// The response has a separate offset in each level of an extra column.
    Block(usize),
    /// The response reading is gain times the truth.
    ResponseGain,
    /// The response reading is the truth plus a bias.
    ResponseBias,
    /// The reading of an input is gain times the truth.
    InputGain(usize),
    /// The reading of an input is the truth plus a bias.
    InputBias(usize),
}

/// A hypothesis in one shape.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// What is missing or wrong.
    pub kind: HypothesisKind,
    /// The change of the response for one unit of each of its unknowns.
    pub columns: Vec<Vec<f64>>,
    /// The same as parts of a polynomial: a list of (factor, product) for each column. Empty if no model file can represent it.
    pub in_file: Vec<Vec<(f64, Monomial)>>,
    /// For blocks: the level without an offset, if there is one.
    pub reference: Option<usize>,
    /// Its prior cost, in addition to that of its unknowns, in units of 2 ln(odds).
    pub prior: f64,
    /// All shapes of one cause have the same group.
    pub group: usize,
}

/// Terms are tested up to this many orders above the highest order of the file,
const ORDERS_ABOVE: u32 = 2;

/// if there are at most this many. With more, data of usual size do not distinguish them.
const MOST_TERMS: usize = 90;

/// Changes between runs are searched at no more than this many places; the best is then refined.
pub(super) const MOST_CHANGES: usize = 40;

/// The smallest number of rows on either side of a change.
pub(super) const LEAST_SIDE: usize = 3;

/// Gains of an input sensor, minus 1, at which a linear hypothesis is made. Between two of them the column changes little.
const GAINS: [f64; 4] = [-0.2, -0.1, 0.1, 0.25];

/// The same for a bias, as shares of half the input's range.
const BIASES: [f64; 4] = [-0.35, -0.15, 0.15, 0.35];

/// Two shapes with a cosine above this between their columns count as one.
const PARALLEL: f64 = 0.9999;

/// A complete order is tested if there are at least this many rows for each of its terms.
const LEAST_ROWS_PER_TERM: usize = 2;

/// The prior cost of one order more: effects are rarer at higher orders (the hierarchy of effects; Wu, Hamada, Experiments, 4.6). 2 ln e.
const PER_ORDER: f64 = 2.0;

/// The prior cost of a change of one coefficient, compared with a sensor or a term, which changes several: 2 ln sqrt(e).
const SINGLE_COEFFICIENT: f64 = 1.0;

/// The prior cost of a change of all coefficients, the least specific hypothesis. It is as much as a further cause with one unknown costs at a usual
/// threshold (chi-squared of 12 has a probability of 5 10^-4), so two specific causes are preferred.
const ALL_COEFFICIENTS: f64 = 12.0;

/// A column counts as dependent on the inputs if less than this share of it is independent.
const SAME: f64 = 1e-7;

/// All hypotheses about a sample.
pub(super) fn all(sample: &Sample) -> Vec<Hypothesis> {
    let mut list = HypothesisList { sample, found: Vec::new(), groups: 0 };
    list.response_sensor();
    list.input_sensors();
    list.missing_terms();
    list.coefficients();
    list.missing_inputs();
    list.blocks();
    list.drift();
    list.steps();
    // Columns that are zero at these rows give no hypothesis.
    list.found.retain(|it| it.columns.iter().all(|column| column.iter().any(|x| *x != 0.0)));
    list.found
}

struct HypothesisList<'a> {
    sample: &'a Sample,
    found: Vec<Hypothesis>,
    groups: usize,
}

fn norm(column: &[f64]) -> f64 {
    dot(column, column).sqrt()
}

impl HypothesisList<'_> {
    fn constant(&self) -> Vec<u32> {
        vec![0; self.sample.surface.width()]
    }

    /// The constant as a part of the file; empty if symmetry forbids it.
    fn constant_in_file(&self) -> Vec<(f64, Monomial)> {
        let powers = self.constant();
        match missing_odd_input(&self.sample.surface, &powers) {
            None => vec![(1.0, Monomial { powers, extra: None })],
            Some(_) => Vec::new(),
        }
    }

    fn new_group(&mut self) -> usize {
        self.groups += 1;
        self.groups - 1
    }

    fn push(
        &mut self,
        group: usize,
        kind: HypothesisKind,
        columns: Vec<Vec<f64>>,
        in_file: Vec<Vec<(f64, Monomial)>>,
        prior: f64,
    ) {
        self.found.push(Hypothesis { kind, columns, in_file, reference: None, prior, group });
    }

    fn response_sensor(&mut self) {
        let group = self.new_group();
        let own = self.sample.surface.terms.iter();
        let own = own.map(|term| (term.coefficient, Monomial { powers: term.powers.clone(), extra: None })).collect();
        self.push(group, HypothesisKind::ResponseGain, vec![self.sample.nominal.clone()], vec![own], 0.0);
        let group = self.new_group();
        let in_file = vec![self.constant_in_file()];
        self.push(group, HypothesisKind::ResponseBias, vec![vec![1.0; self.sample.rows()]], in_file, 0.0);
    }

    /// Secants of the polynomial, divided by the change, so that every unknown is gain - 1, or bias.
    fn input_sensors(&mut self) {
        for input in 0..self.sample.inputs.len() {
            if self.sample.is_contrast(input) {
                continue;
            }
            // The phase of a wave refers to the middle of the range, so the file cannot represent another gain or bias of its input.
            if self.sample.surface.waves.iter().any(|wave| wave.input == self.sample.inputs[input].name) {
                continue;
            }
            let half = (self.sample.inputs[input].range[1] - self.sample.inputs[input].range[0]) / 2.0;
            // A step of 10^-3 of a gain or of half the range: the central difference gives the derivative to six digits.
            let gain = |g: f64| [(1.0 + g, 0.0), (1.0, 0.0)];
            let bias = |b: f64| [(1.0, b * half), (1.0, 0.0)];
            let gains: Vec<_> =
                std::iter::once(([(1.001, 0.0), (0.999, 0.0)], 0.002)).chain(GAINS.map(|g| (gain(g), g))).collect();
            let biases: Vec<_> = std::iter::once(([(1.0, 0.001 * half), (1.0, -0.001 * half)], 0.002 * half))
                .chain(BIASES.map(|b| (bias(b), b * half)))
                .collect();
            for (kind, secants) in [(HypothesisKind::InputGain(input), gains), (HypothesisKind::InputBias(input), biases)] {
                let group = self.new_group();
                let mut known: Vec<Vec<f64>> = Vec::new();
                for ([there, here], change) in secants {
                    let (there, here) = (moved(self.sample, input, there), moved(self.sample, input, here));
                    let column: Vec<f64> = there.iter().zip(&here).map(|(a, b)| (a - b) / change).collect();
                    let size = norm(&column);
                    if size.is_finite() && !known.iter().any(|other| dot(other, &column).abs() > PARALLEL * size * norm(other))
                    {
                        known.push(column.clone());
                        self.push(group, kind.clone(), vec![column], vec![Vec::new()], 0.0);
                    }
                }
            }
        }
    }

    fn missing_terms(&mut self) {
        let surface = &self.sample.surface;
        let highest = surface.terms.iter().map(|term| design::order(&term.powers)).max().unwrap_or(0);
        let width = surface.width();
        let mut order = highest + ORDERS_ABOVE;
        while order > highest && design::count_of_terms(width, order) > MOST_TERMS {
            order -= 1;
        }
        let has = |powers: &Vec<u32>| surface.terms.iter().any(|term| term.powers == *powers);
        let missing: Vec<Vec<u32>> = terms_up_to(surface, order).into_iter().filter(|powers| !has(powers)).collect();
        let columns = self.sample.columns_of(&missing, &self.sample.points);
        let present: Vec<Monomial> =
            surface.terms.iter().map(|term| Monomial { powers: term.powers.clone(), extra: None }).collect();
        let spread = self.sample.columns_of(&missing, &self.sample.spread);
        let present_powers: Vec<Vec<u32>> = present.iter().map(|it| it.powers.clone()).collect();
        let spread_terms = self.sample.columns_of(&present_powers, &self.sample.spread);
        let next: Vec<usize> =
            (0..missing.len()).filter(|k| (1..=highest + 1).contains(&design::order(&missing[*k]))).collect();
        if next.len() > 1 && next.len() * LEAST_ROWS_PER_TERM <= self.sample.rows() {
            let group = self.new_group();
            let own = |k: &usize| vec![(1.0, Monomial { powers: missing[*k].clone(), extra: None })];
            let of_next = next.iter().map(|k| columns[*k].clone()).collect();
            self.push(group, HypothesisKind::Order(highest + 1), of_next, next.iter().map(own).collect(), 0.0);
        }
        for ((powers, column), spread) in missing.into_iter().zip(columns).zip(spread) {
            if design::order(&powers) == 0 {
                continue; // the response's bias
            }
            let prior = PER_ORDER * f64::from(design::order(&powers).saturating_sub(highest + 1));
            let own = Monomial { powers: powers.clone(), extra: None };
            let group = self.new_group();
            self.push(group, HypothesisKind::Term(powers.clone()), vec![column.clone()], vec![vec![(1.0, own.clone())]], prior);
            // The coefficients of the old fit contain the part of the missing term that they can imitate, for a design like this one or for evenly
            // spread rows.
            for (terms, there) in [(&self.sample.terms, &column), (&spread_terms, &spread)] {
                let absorbed = solve(terms, there).coefficients;
                let mut left = column.clone();
                for (term, amount) in self.sample.terms.iter().zip(&absorbed) {
                    subtract(&mut left, term, *amount);
                }
                if norm(&left) > SAME * norm(&column) && dot(&left, &column).abs() < PARALLEL * norm(&left) * norm(&column) {
                    let taken = absorbed.iter().zip(&present).map(|(a, monomial)| (-a, monomial.clone()));
                    let in_file = std::iter::once((1.0, own.clone())).chain(taken).collect();
                    self.push(group, HypothesisKind::Term(powers.clone()), vec![left], vec![in_file], prior);
                }
            }
        }
    }

    fn coefficients(&mut self) {
        let of = |powers: &Vec<u32>| vec![(1.0, Monomial { powers: powers.clone(), extra: None })];
        if self.sample.surface.terms.len() > 1 && self.sample.surface.terms.len() * LEAST_ROWS_PER_TERM <= self.sample.rows() {
            let group = self.new_group();
            let in_file = self.sample.surface.terms.iter().map(|term| of(&term.powers)).collect();
            self.push(group, HypothesisKind::Refit, self.sample.terms.clone(), in_file, ALL_COEFFICIENTS);
        }
        for (k, term) in self.sample.surface.terms.iter().enumerate() {
            if design::order(&term.powers) == 0 {
                continue; // the response's bias
            }
            let group = self.groups;
            self.groups += 1;
            let in_file = vec![vec![(1.0, Monomial { powers: term.powers.clone(), extra: None })]];
            let columns = vec![self.sample.terms[k].clone()];
            self.found.push(Hypothesis {
                kind: HypothesisKind::Coefficient(k),
                columns,
                in_file,
                reference: None,
                prior: SINGLE_COEFFICIENT,
                group,
            });
        }
    }

    /// The span of the model's inputs with the constant.
    fn known(&self) -> Basis {
        let mut known = vec![vec![1.0; self.sample.rows()]];
        known.extend((0..self.sample.inputs.len()).map(|input| self.sample.coded(input)));
        known.extend(self.sample.points.iter().cloned());
        Basis::of(&known)
    }

    fn missing_inputs(&mut self) {
        let known = self.known();
        for extra in 0..self.sample.extras.len() {
            let it = &self.sample.extras[extra];
            let (Some(values), Some((middle, half))) = (it.values.as_ref(), it.coding()) else { continue };
            if it.clock || half <= 0.0 {
                continue;
            }
            let z: Vec<f64> = values.iter().map(|value| (value - middle) / half).collect();
            let mut own = z.clone();
            known.project_out(&mut own);
            if norm(&own) < SAME * norm(&z) {
                continue;
            }
            let one = vec![1.0; z.len()];
            let constant = self.constant();
            let power = |k: u32| Monomial { powers: constant.clone(), extra: Some((extra, k)) };
            let may_be_alone = missing_odd_input(&self.sample.surface, &constant).is_none();
            let allowed = |monomial: Monomial| if may_be_alone { vec![(1.0, monomial)] } else { Vec::new() };
            let unit = self.constant_in_file();
            // Three shapes: about the middle of the new values, about zero, and about an unknown value (with its own offset).
            let group = self.new_group();
            let linear = HypothesisKind::Input(extra, Part::Linear);
            self.push(group, linear.clone(), vec![z.clone()], vec![allowed(power(1))], 0.0);
            let shift = middle / half;
            // If the middle is near zero, both shapes are the same.
            if shift.abs() > 0.1 {
                let raw = z.iter().map(|z| z + shift).collect();
                let in_file = allowed(power(1)).into_iter().chain(unit.iter().map(|(_, m)| (shift, m.clone()))).collect();
                self.push(group, linear.clone(), vec![raw], vec![in_file], 0.0);
            }
            self.push(group, linear, vec![z.clone(), one.clone()], vec![allowed(power(1)), unit.clone()], 0.0);
            let square: Vec<f64> = z.iter().map(|z| z * z).collect();
            if square.iter().any(|z| (z - 1.0).abs() > SAME) {
                let group = self.new_group();
                let kind = HypothesisKind::Input(extra, Part::Square);
                self.push(group, kind.clone(), vec![square.clone()], vec![allowed(power(2))], PER_ORDER);
                self.push(group, kind, vec![square, one], vec![allowed(power(2)), unit], PER_ORDER);
            }
            for input in 0..self.sample.inputs.len() {
                let mut powers = constant.clone();
                powers[input] = 1;
                if missing_odd_input(&self.sample.surface, &powers).is_some() {
                    continue;
                }
                let x = self.sample.columns_of(std::slice::from_ref(&powers), &self.sample.points).remove(0);
                let product: Vec<f64> = z.iter().zip(&x).map(|(z, x)| z * x).collect();
                let own = Monomial { powers: powers.clone(), extra: Some((extra, 1)) };
                let main = Monomial { powers, extra: None };
                let group = self.new_group();
                let kind = HypothesisKind::Input(extra, Part::With(input));
                let in_file = vec![vec![(1.0, own.clone())], vec![(1.0, main)]];
                self.push(group, kind.clone(), vec![product.clone()], vec![vec![(1.0, own)]], PER_ORDER);
                self.push(group, kind, vec![product, x], in_file, PER_ORDER);
            }
        }
    }

    fn blocks(&mut self) {
        for extra in 0..self.sample.extras.len() {
            let Some((names, of)) = &self.sample.extras[extra].levels else { continue };
            let used: Vec<usize> = (0..names.len()).filter(|level| of.contains(level)).collect();
            if used.len() < 2 {
                continue;
            }
            let columns: Vec<Vec<f64>> =
                used.iter().map(|level| of.iter().map(|it| f64::from(u8::from(it == level))).collect()).collect();
            let group = self.new_group();
            let nowhere = |columns: &[Vec<f64>]| vec![Vec::new(); columns.len()];
            // Each level in turn as the one for which the model was made. With many levels, probably none is.
            const MOST_REFERENCES: usize = 8;
            if used.len() <= MOST_REFERENCES {
                for (place, level) in used.iter().enumerate() {
                    let mut others = columns.clone();
                    others.remove(place);
                    let in_file = nowhere(&others);
                    let prior = 0.0;
                    let reference = Some(*level);
                    self.found.push(Hypothesis {
                        kind: HypothesisKind::Block(extra),
                        columns: others,
                        in_file,
                        reference,
                        prior,
                        group,
                    });
                }
            }
            let in_file = nowhere(&columns);
            self.push(group, HypothesisKind::Block(extra), columns, in_file, 0.0);
        }
    }

    fn drift(&mut self) {
        let of_order: Vec<f64> = self.sample.places.iter().map(|place| *place as f64).collect();
        let group = self.new_group();
        let extras = self.sample.extras.iter().enumerate();
        let clocks = extras.filter(|(_, it)| it.clock).filter_map(|(k, it)| Some((Some(k), it.values.clone()?)));
        let clocks: Vec<(Option<usize>, Vec<f64>)> = std::iter::once((None, of_order)).chain(clocks).collect();
        for (clock, time) in clocks {
            let (first, last) = (time[0], time[time.len() - 1]);
            let span = (last - first).max(f64::MIN_POSITIVE);
            // The response is right at the first run, or in the middle.
            for from in [first, (first + last) / 2.0] {
                let column = time.iter().map(|t| (t - from) / span).collect();
                self.push(group, HypothesisKind::Drift(clock), vec![column], vec![Vec::new()], 0.0);
            }
        }
    }

    fn steps(&mut self) {
        let rows = self.sample.rows();
        let places = step_places(rows);
        // The odds of a change are shared by all its places. Otherwise a change near an end would fit better than a plain offset, only by the choice
        // of its place.
        let prior = 2.0 * (places.len().max(1) as f64).ln();
        for at in places {
            let group = self.new_group();
            for before in [0.0, -1.0] {
                self.push(group, HypothesisKind::Step(at), vec![step(rows, at, before)], vec![Vec::new()], prior);
            }
        }
    }
}

/// The rows before which a change is tested.
fn step_places(rows: usize) -> Vec<usize> {
    let last = rows.saturating_sub(LEAST_SIDE);
    if last < LEAST_SIDE {
        return Vec::new();
    }
    let count = last - LEAST_SIDE + 1;
    if count <= MOST_CHANGES {
        return (LEAST_SIDE..=last).collect();
    }
    (0..MOST_CHANGES).map(|k| LEAST_SIDE + k * (count - 1) / (MOST_CHANGES - 1)).collect()
}

/// A change by 1 at a row: `before`, then `before` + 1.
pub(super) fn step(rows: usize, at: usize, before: f64) -> Vec<f64> {
    (0..rows).map(|row| if row < at { before } else { before + 1.0 }).collect()
}

/// The polynomial at the true value of one input, if its sensor reads gain times the truth plus bias.
pub(super) fn moved(sample: &Sample, input: usize, (gain, bias): (f64, f64)) -> Vec<f64> {
    let mut points = sample.points.clone();
    points[input].iter_mut().for_each(|xi| *xi = (*xi - bias) / gain);
    sample.polynomial(&points)
}

/// The name of a term in lists and reports: `1`, `speed`, `torque^2*speed`.
pub(super) fn name_of(sample: &Sample, monomial: &Monomial) -> String {
    let own = sample.surface.term_name(&monomial.powers);
    match monomial.extra {
        None => own,
        Some((extra, power)) => {
            let name = &sample.extras[extra].name;
            let name = if power == 1 { name.clone() } else { format!("{name}^{power}") };
            if own == "1" { name } else { format!("{own}*{name}") }
        }
    }
}

impl HypothesisKind {
    /// KIND, or KIND:NAME, as in lists of causes.
    pub fn label(&self, sample: &Sample) -> String {
        let term = |powers: &[u32]| sample.surface.term_name(powers);
        match self {
            HypothesisKind::Term(powers) => format!("missing-term:{}", term(powers)),
            HypothesisKind::Order(order) => format!("missing-term:order {order}"),
            HypothesisKind::Refit => "coefficient-error:all terms".to_string(),
            HypothesisKind::Coefficient(k) => format!("coefficient-error:{}", term(&sample.surface.terms[*k].powers)),
            HypothesisKind::Input(extra, _) => format!("missing-input:{}", sample.extras[*extra].name),
            HypothesisKind::Drift(_) | HypothesisKind::Step(_) => "drift".to_string(),
            HypothesisKind::Block(extra) => format!("block-offset:{}", sample.extras[*extra].name),
            HypothesisKind::ResponseGain => format!("sensor-gain:{}", sample.surface.name),
            HypothesisKind::ResponseBias => format!("sensor-bias:{}", sample.surface.name),
            HypothesisKind::InputGain(input) => format!("sensor-gain:{}", sample.inputs[*input].name),
            HypothesisKind::InputBias(input) => format!("sensor-bias:{}", sample.inputs[*input].name),
        }
    }
}

/// Whether a model file can contain the bias of an input: mirrored and inverted variables cannot be shifted.
pub(super) fn bias_fits_file(sample: &Sample, input: usize) -> bool {
    let name = &sample.inputs[input].name;
    let has_waves = sample.surface.waves.iter().any(|wave| wave.input == *name);
    !has_waves && !sample.surface.symmetry.iter().any(|(other, _)| other == name) && !sample.surface.reciprocal.contains(name)
}
