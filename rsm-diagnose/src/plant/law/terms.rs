//! The terms of a law at a site, and the law as the text of an effect and as a response surface.
//!
//! In: a site with its variables, and their ranges along the records. Out: candidate terms; the file of the effect; the surface. Fits nothing.
//!
//! A law is a polynomial in coded variables, each from -1 to 1 over its range. Where the first variable is a speed that changes its sign, its smooth
//! sign is one more variable: dry friction is no polynomial. Two smooth steps that are wider, the sigmoids of surfaces over the speed, represent what
//! rises and falls near rest.

use rsm_core::order;
use std::fmt::Write as _;

use rsm_core::model::{Input, Model, Outside, Sigmoid, Surface, Term as SurfaceTerm};
use rsm_core::number::decimal;
use rsm_sim::equation_plant::added::Balance;

/// The highest order of a term. A polynomial of higher order oscillates between the values that the records visit.
const HIGHEST_ORDER: u32 = 5;

/// The highest power of the first variable alone. A law that rises and falls on both sides of rest needs more than the fifth.
const HIGHEST_POWER: u32 = 7;

/// The highest order of a term with the sign of the speed: friction that depends on the speed.
const ORDER_WITH_SIGN: u32 = 2;

/// A range is widened by this share on both sides, so that the motion of another record stays inside.
const WIDENED: f64 = 0.05;

/// An angle is a variable of a law up to this range, in rad: two turns. Over more turns a law of the angle repeats itself, and a polynomial cannot
/// represent it; the effects of the catalogue contain waves over the angle.
const MOST_ANGLE: f64 = 4.0 * std::f64::consts::PI;

/// The highest order of a term with a smooth step.
const ORDER_WITH_STEP: u32 = 1;

/// The widths of the smooth steps, as shares of half of the range. Narrower ones look like the sign, wider ones like a polynomial of third order.
const STEP_WIDTHS: [f64; 2] = [0.1, 0.3];

/// The name of the variable with the sign of the speed.
pub const DIRECTION: &str = "direction";

/// A variable of a law.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// The name of the role in the site.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Its range along the records, widened.
    pub range: [f64; 2],
}

/// The form of a law before its coefficients.
#[derive(Debug, Clone, PartialEq)]
pub struct Form {
    /// The site.
    pub balance: Balance,
    /// The variables of the site that vary.
    pub variables: Vec<Variable>,
    /// The width of the smooth sign of the first variable, if the law has one, in the unit of this variable.
    pub width: Option<f64>,
    /// The widths of the smooth steps of the first variable; none without a sign.
    pub steps: Vec<f64>,
    /// The candidate terms: powers of the variables, and, if the law has a sign, of the sign and the smooth steps.
    pub terms: Vec<Vec<u32>>,
}

impl Form {
    /// The form of a law at a site, from the values of its variables along the records. `None` if no variable varies.
    #[must_use]
    pub fn new(balance: &Balance, values: &[Vec<f64>]) -> Option<Form> {
        let mut variables = Vec::new();
        for ((name, unit), values) in balance.variables.iter().zip(values) {
            let finite = values.iter().filter(|it| it.is_finite());
            let (low, high) = order::ends(finite);
            let width = high - low;
            let is_long_angle = balance.kind == "rotation" && name == "position" && width > MOST_ANGLE;
            // The accuracy of a simulation: a variable that varies less is constant.
            if width.is_finite() && width > 1e-6 * high.abs().max(low.abs()) && !is_long_angle {
                let range = [low - WIDENED * width, high + WIDENED * width];
                variables.push(Variable { name: name.clone(), unit: unit.clone(), range });
            }
        }
        let first = variables.first()?;
        if first.name != balance.variables[0].0 {
            return None;
        }
        // The widths of the effects of the catalogue (docs/book/src/reference/plants.md 3).
        let width = match balance.kind {
            "rotation" | "vehicle" => Some(1.0),
            "translation" => Some(1e-3),
            _ => None,
        };
        let width = width.filter(|_| first.range[0] < 0.0 && first.range[1] > 0.0);
        let mut terms = powers_up_to(variables.len(), HIGHEST_ORDER);
        terms.extend((HIGHEST_ORDER + 1..=HIGHEST_POWER).map(|power| {
            let mut alone = vec![0; variables.len()];
            alone[0] = power;
            alone
        }));
        let half = 0.5 * (first.range[1] - first.range[0]);
        let steps = if width.is_some() { STEP_WIDTHS.map(|share| share * half).to_vec() } else { Vec::new() };
        if width.is_some() {
            let orders = [ORDER_WITH_SIGN].into_iter().chain(steps.iter().map(|_| ORDER_WITH_STEP));
            let mut with: Vec<Vec<u32>> = Vec::new();
            for (place, order) in orders.enumerate() {
                let mut factor = vec![0; 1 + steps.len()];
                factor[place] = 1;
                with.extend(powers_up_to(variables.len(), order).into_iter().map(|it| [it, factor.clone()].concat()));
            }
            terms.iter_mut().for_each(|it| it.extend(vec![0; 1 + steps.len()]));
            terms.extend(with);
        }
        Some(Form { balance: balance.clone(), variables, width, steps, terms })
    }

    /// The name of the effect.
    #[must_use]
    pub fn effect(&self) -> String {
        format!("law-of-{}", self.balance.at.replace(['_', '.'], "-"))
    }

    /// The name of the number with the coefficient of a term.
    #[must_use]
    pub fn number(&self, term: &[u32]) -> String {
        let steps = (1..=self.steps.len()).map(|k| format!("step{k}"));
        let names = self.variables.iter().map(|it| it.name.clone()).chain([DIRECTION.to_string()]).chain(steps);
        let factors = names.zip(term).filter(|it| *it.1 > 0).map(|(name, power)| format!("{name}_{power}"));
        let all: Vec<String> = factors.collect();
        if all.is_empty() { "offset".to_string() } else { all.join("_") }
    }

    /// The value of a term at values of the variables.
    #[must_use]
    pub fn value(&self, term: &[u32], at: &[f64]) -> f64 {
        let coded = self.variables.iter().zip(at).map(|(it, value)| {
            let [low, high] = it.range;
            (value.max(low).min(high) - 0.5 * (low + high)) / (0.5 * (high - low))
        });
        let sign = self.width.map(|width| (at[0] / width).tanh());
        let first = &self.variables[0];
        let inside = at[0].max(first.range[0]).min(first.range[1]);
        let steps = self.steps.iter().map(|width| {
            let ratio = inside / width;
            ratio * (1.0 + ratio.abs()) / (1.0 + ratio.abs() + ratio * ratio)
        });
        coded.chain(sign).chain(steps).zip(term).map(|(value, power)| value.powi(*power as i32)).product()
    }

    /// The file of the effect with these terms, and numbers in the text as defaults: 0.
    #[must_use]
    pub fn text(&self, terms: &[Vec<u32>], sentence: &str) -> String {
        let Balance { kind, term, unit, .. } = &self.balance;
        let mut text = format!(
            "format = 1\nkind = \"{}\"\nsites = [\"{kind}\"]\nsource = \"fitted to records: no textbook law\"\n\n[numbers]\n",
            self.effect()
        );
        for term in terms {
            let _ = writeln!(
                text,
                "{} = {{ unit = \"{unit}\", default = 0.0, neutral = 0.0, guess = [\"0.05*effort_scale\"] }}",
                self.number(term)
            );
        }
        text.push_str("\n[helpers]\n");
        for it in &self.variables {
            let (name, [low, high]) = (&it.name, it.range);
            for (end, value) in [("low", low), ("high", high), ("mid", 0.5 * (low + high)), ("half", 0.5 * (high - low))] {
                let _ = writeln!(text, "{name}_{end} = {{ value = {}, unit = \"{{{name}}}\" }}", decimal(value));
            }
            let _ = writeln!(
                text,
                "{name}_coded = \"(noEvent(min(max({name}, {name}_low), {name}_high)) - {name}_mid)/{name}_half\""
            );
        }
        if let Some(width) = self.width {
            let name = &self.variables[0].name;
            let _ = writeln!(text, "{name}_width = {{ value = {}, unit = \"{{{name}}}\" }}", decimal(width));
            let _ = writeln!(text, "{DIRECTION} = \"tanh({name}/{name}_width)\"");
            for (k, width) in self.steps.iter().enumerate() {
                let inside = format!("noEvent(min(max({name}, {name}_low), {name}_high))");
                let _ = writeln!(text, "{name}_width{} = {{ value = {}, unit = \"{{{name}}}\" }}", k + 1, decimal(*width));
                let _ = writeln!(text, "ratio{0} = \"{inside}/{name}_width{0}\"", k + 1);
                let law = "ratio*(1 + noEvent(abs(ratio)))/(1 + noEvent(abs(ratio)) + ratio^2)";
                let _ = writeln!(text, "step{} = \"{}\"", k + 1, law.replace("ratio", &format!("ratio{}", k + 1)));
            }
        }
        let steps = (1..=self.steps.len()).map(|k| format!("step{k}"));
        let names: Vec<String> =
            self.variables.iter().map(|it| format!("{}_coded", it.name)).chain([DIRECTION.to_string()]).chain(steps).collect();
        let product = |term: &Vec<u32>| {
            let factors = names.iter().zip(term).filter(|it| *it.1 > 0);
            let factors = factors.map(|(name, power)| if *power == 1 { name.clone() } else { format!("{name}^{power}") });
            [self.number(term)].into_iter().chain(factors).collect::<Vec<_>>().join("*")
        };
        let sum: Vec<String> = terms.iter().map(product).collect();
        let _ = write!(
            text,
            "\n[changes]\n{term} = \"{}\"\n\n[words]\nsentence = \"{sentence}\"\ncheck = \"Measure the {term} at several constant values of {}.\"\n",
            sum.join(" + "),
            self.variables.iter().map(|it| it.name.as_str()).collect::<Vec<_>>().join(" and "),
        );
        text
    }

    /// The law as a model file with one surface.
    #[must_use]
    pub fn model(&self, terms: &[Vec<u32>], coefficients: &[f64], unit: &str) -> Model {
        let mut inputs: Vec<Input> = self
            .variables
            .iter()
            .map(|it| Input { name: it.name.clone(), unit: it.unit.clone(), range: it.range, outside: Outside::Clamp })
            .collect();
        if self.width.is_some() {
            let range = [-1.0, 1.0];
            inputs.push(Input { name: DIRECTION.to_string(), unit: "1".to_string(), range, outside: Outside::Clamp });
        }
        // An input that no term contains is left out; a step needs the first one.
        let has = |k: usize| terms.iter().any(|it| it[k] > 0);
        let steps: Vec<usize> = (0..self.steps.len()).filter(|k| has(inputs.len() + k)).collect();
        let kept: Vec<usize> = (0..inputs.len()).filter(|k| has(*k) || *k == 0 && !steps.is_empty()).collect();
        let sigmoids =
            steps.iter().map(|k| Sigmoid { input: self.variables[0].name.clone(), at: 0.0, width: self.steps[*k] }).collect();
        let places: Vec<usize> = kept.iter().copied().chain(steps.iter().map(|k| inputs.len() + k)).collect();
        let inputs: Vec<Input> = kept.iter().map(|k| inputs[*k].clone()).collect();
        let cut = |term: &[u32]| places.iter().map(|k| term[*k]).collect::<Vec<u32>>();
        let surface = Surface {
            name: self.surface(),
            unit: unit.to_string(),
            inputs: inputs.iter().map(|it| it.name.clone()).collect(),
            sigmoids,
            terms: terms.iter().zip(coefficients).map(|(term, c)| SurfaceTerm { powers: cut(term), coefficient: *c }).collect(),
            ..Surface::default()
        };
        Model { name: "law".to_string(), inputs, surfaces: vec![surface], ..Model::default() }
    }

    /// The name of the surface.
    #[must_use]
    pub fn surface(&self) -> String {
        format!("{}_{}", self.balance.at.replace('.', "_"), self.balance.term)
    }
}

/// All powers of so many variables with a sum up to `order`, the lowest sums first.
fn powers_up_to(variables: usize, order: u32) -> Vec<Vec<u32>> {
    let mut all = vec![Vec::new()];
    for _ in 0..variables {
        all =
            all.into_iter().flat_map(|it: Vec<u32>| (0..=order).map(move |power| [it.clone(), vec![power]].concat())).collect();
    }
    all.retain(|it| it.iter().sum::<u32>() <= order);
    all.sort_by_key(|it| it.iter().sum::<u32>());
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn carriage() -> Balance {
        let variables = [("speed", "m/s"), ("position", "m")].map(|(name, unit)| (name.to_string(), unit.to_string())).to_vec();
        Balance { at: "carriage".to_string(), kind: "translation", term: "effort", unit: "N", variables }
    }

    #[test]
    fn a_speed_that_changes_its_sign_gives_terms_with_the_sign() {
        let both = Form::new(&carriage(), &[vec![-1.0, 1.0], vec![0.0, 2.0]]).unwrap();
        // 21 polynomial terms of two variables to order 5, two higher powers of the speed, 6 terms with the sign to order 2, and 3 with each of the
        // two steps to order 1.
        assert_eq!((both.terms.len(), both.width), (35, Some(1e-3)));
        assert_eq!(both.variables[1].range, [-0.1, 2.1]);
        let one = Form::new(&carriage(), &[vec![0.5, 1.0], vec![3.0, 3.0]]).unwrap();
        assert_eq!((one.terms.len(), one.width, one.variables.len()), (8, None, 1));
        assert_eq!(Form::new(&carriage(), &[vec![1.0, 1.0], vec![0.0, 1.0]]), None);
    }

    #[test]
    fn the_text_is_an_effect_and_the_model_is_a_surface_with_the_same_values() {
        let form = Form::new(&carriage(), &[vec![-1.0, 1.0], vec![0.0, 2.0]]).unwrap();
        let terms = vec![vec![0, 0, 0, 0, 0], vec![2, 1, 0, 0, 0], vec![0, 0, 1, 0, 0], vec![1, 0, 0, 0, 1]];
        let text = form.text(&terms, "A law.");
        let plain = "model Cart\n  parameter Real mass(unit = \"kg\") = 2;\n  input Real force(unit = \"N\");\n  Real speed(unit = \"m/s\");\n  \
                     output Real position(unit = \"m\");\nequation\n  mass*der(speed) = force;\n  der(position) = speed;\nend Cart;\n";
        let open = |name: &str| Ok::<_, rsm_core::source::Faults>(rsm_core::source::Source::new(name, plain));
        let file = "format = 2\nmodel = \"cart.mo\"\n[sites.carriage]\nkind = \"translation\"\nspeed = \"speed\"\nposition = \"position\"\ninertia = \"mass\"\n";
        let plant = rsm_sim::equation_plant::read(&rsm_core::source::Source::new("cart.toml", file), &open).unwrap();
        let extended = rsm_sim::equation_plant::added::with_effect(&plant, "law-effect.toml", &text);
        let extended = extended.unwrap_or_else(|faults| panic!("{faults}\n{text}"));
        assert!(extended.write().contains("effect_files = [\"law-effect.toml\"]"), "{}", extended.write());
        let coefficients = [3.0, -2.0, 0.5, 4.0];
        let model = form.model(&terms, &coefficients, "N");
        let checked = rsm_core::check::Checked::from_model(&model).unwrap();
        let tape = rsm_core::lower::surface(&checked, 0, rsm_core::number::Precision::F64);
        let mut surface = rsm_core::run::Interpreter::<f64>::new(&tape);
        for at in [[0.3, 0.2], [-0.7, 1.9], [0.0004, 1.0]] {
            let by_terms: f64 = terms.iter().zip(coefficients).map(|(term, c)| c * form.value(term, &at)).sum();
            let sign = (at[0] / 1e-3).tanh();
            let by_surface = surface.eval(&[at[0], at[1], sign]);
            // Both round some ten operations on values up to 6.
            assert!((by_terms - by_surface).abs() < 1e-13, "{by_terms} {by_surface}");
        }
    }
}
