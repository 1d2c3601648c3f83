//! The parts of a model: inputs with ranges, surfaces with terms, compensators. Plain data without checks.
//!
//! Read from a file by [`crate::model_file`], created by the fitter, checked by [`crate::check`]. The exact value of a surface is the real polynomial
//! with exactly these f64 coefficients and exact coded variables.

mod forms;

pub use forms::{Category, Coding, Knot, Sigmoid, Spline, Symmetry, Transform, Wave};

/// A model: one file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Model {
    /// The name, the prefix of every emitted C name and the module name in Rust.
    pub name: String,
    /// The natural variables, in the order of the file.
    pub inputs: Vec<Input>,
    /// The response surfaces, in the order of the file.
    pub surfaces: Vec<Surface>,
    /// The compensators, in the order of the file.
    pub compensators: Vec<Compensator>,
}

/// A natural variable xi.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// Its name.
    pub name: String,
    /// Its unit, as text.
    pub unit: String,
    /// Lowest and highest value, in `unit`.
    pub range: [f64; 2],
    /// The behaviour of an evaluator outside the range.
    pub outside: Outside,
}

/// The behaviour of an evaluator for a value outside the range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Outside {
    /// The value is limited to the nearest bound.
    #[default]
    Clamp,
    /// The polynomial is extrapolated.
    Extrapolate,
}

/// A response surface: one polynomial.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surface {
    /// Its name.
    pub name: String,
    /// The unit of the response, as text.
    pub unit: String,
    /// The names of its inputs: the order of powers and of the evaluator's arguments.
    pub inputs: Vec<String>,
    /// The range to which the evaluator limits the result.
    pub output_range: Option<[f64; 2]>,
    /// The coding of the variables.
    pub coding: Coding,
    /// Inputs that enter by their magnitude.
    pub symmetry: Vec<(String, Symmetry)>,
    /// Hinge variables max(0, x - x_knot), appended to the powers in this order.
    pub knots: Vec<Knot>,
    /// Sigmoid variables, appended to the powers after the hinges, in this order.
    pub sigmoids: Vec<Sigmoid>,
    /// Waves over an input, appended to the powers after the sigmoids, in this order: of each its cosine, then its sine.
    pub waves: Vec<Wave>,
    /// Inputs that enter by their reciprocal.
    pub reciprocal: Vec<String>,
    /// Categories, whose contrasts are inputs of this surface.
    pub categories: Vec<Category>,
    /// The transform of the response that the terms or the spline describe; `None`: they describe the response itself.
    pub transform: Option<Transform>,
    /// The polynomial. Empty if the surface is a spline.
    pub terms: Vec<Term>,
    /// The spline that is the whole surface, instead of `terms`.
    pub spline: Option<Spline>,
    /// The region in which the data support the surface: every half-space must hold. Empty: everywhere.
    pub support: Vec<HalfSpace>,
    /// Written by the fitter, shown in reports, ignored by the compiler.
    pub evidence: Vec<(String, Evidence)>,
}

impl Surface {
    /// The name of a term in messages and emitted code: `1`, `speed`, `torque^2*speed`, `hinge(speed, 465)`.
    ///
    /// ```
    /// # let text = "format = 1\nmodel = \"car\"\n[inputs.speed]\nunit = \"m/s\"\nrange = [0.0, 30.0]\n[surfaces.drag]\nunit = \"N\"\n\
    /// #     inputs = [\"speed\"]\nterms = [{ powers = [0], coefficient = 35.0 }, { powers = [2], coefficient = 30.0 }]\n";
    /// # let checked = rsm_core::check::Checked::read(&rsm_core::source::Source::new("car.toml", text))?;
    /// let drag = &checked.model().surfaces[0];
    /// assert_eq!(drag.term_name(&drag.terms[1].powers), "speed^2");
    /// # Ok::<(), rsm_core::source::Faults>(())
    /// ```
    #[must_use]
    pub fn term_name(&self, powers: &[u32]) -> String {
        let own = self.inputs.iter().cloned();
        let hinges = self.knots.iter().map(|knot| format!("hinge({}, {})", knot.input, knot.at));
        let sigmoid = |sigmoid: &Sigmoid| format!("sigmoid({}, {}, {})", sigmoid.input, sigmoid.at, sigmoid.width);
        let waves = |Wave { input, order, .. }: &Wave| ["cos", "sin"].map(|name| format!("{name}({order}*{input})"));
        let factors: Vec<String> = own
            .chain(hinges)
            .chain(self.sigmoids.iter().map(sigmoid))
            .chain(self.waves.iter().flat_map(waves))
            .zip(powers)
            .filter(|(_, power)| **power > 0)
            .map(|(factor, power)| if *power == 1 { factor } else { format!("{factor}^{power}") })
            .collect();
        if factors.is_empty() { "1".to_string() } else { factors.join("*") }
    }

    /// The number of powers of a term: one for every input, one for every knot, one for every sigmoid, and two for every wave.
    #[must_use]
    pub fn width(&self) -> usize {
        self.inputs.len() + self.knots.len() + self.sigmoids.len() + 2 * self.waves.len()
    }

    /// Whether a term contains a sigmoid or wave, which is not a polynomial on any piece of the box.
    #[must_use]
    pub fn is_bent(&self) -> bool {
        let first = self.inputs.len() + self.knots.len();
        self.terms.iter().any(|term| term.coefficient != 0.0 && term.powers.iter().skip(first).any(|power| *power > 0))
    }

    /// The unit of the terms: that of the response, or of its transform, such as `log(N)`.
    #[must_use]
    pub fn unit_of_terms(&self) -> String {
        match self.transform {
            Some(transform) if !self.unit.is_empty() && self.unit != "1" => transform.words(&self.unit),
            _ => self.unit.clone(),
        }
    }

    /// Whether an input is the contrast of a category.
    #[must_use]
    pub fn is_contrast(&self, input: &str) -> bool {
        self.categories.iter().flat_map(|category| &category.inputs).any(|known| known == input)
    }

    /// Whether an input has `symmetry`, `knots`, `sigmoids`, `waves` or `reciprocal`.
    #[must_use]
    pub fn has_form(&self, input: &str) -> bool {
        let knots = self.knots.iter().map(|knot| &knot.input);
        let made =
            knots.chain(self.sigmoids.iter().map(|sigmoid| &sigmoid.input)).chain(self.waves.iter().map(|wave| &wave.input));
        self.is_symmetric(input) || self.reciprocal.iter().chain(made).any(|name| name == input)
    }

    /// Whether an input enters by its magnitude.
    #[must_use]
    pub fn is_symmetric(&self, input: &str) -> bool {
        self.symmetry.iter().any(|(name, _)| name == input)
    }
}

/// One term of the polynomial.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// A power for every input, then one for every knot, then one for every sigmoid, then two for every wave.
    pub powers: Vec<u32>,
    /// The factor before the product of powers, in the unit of the response.
    pub coefficient: f64,
}

/// normal . x <= bound, in coded variables of the inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct HalfSpace {
    /// One number for each input.
    pub normal: Vec<f64>,
    /// The right-hand side.
    pub bound: f64,
}

/// A piece of evidence: any TOML value.
#[derive(Debug, Clone, PartialEq)]
pub enum Evidence {
    /// An integer.
    Whole(i64),
    /// A number.
    Number(f64),
    /// A flag.
    Flag(bool),
    /// A text.
    Text(String),
    /// Several of them.
    List(Vec<Evidence>),
    /// Named ones, in order.
    Table(Vec<(String, Evidence)>),
}

/// (a s^2 + b s + c)/(a s^2 + d s + c), section 4 of the paper. With a separate natural frequency of the poles, the poles also move in frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct Compensator {
    /// Its name.
    pub name: String,
    /// Sample time in seconds.
    pub sample_time: f64,
    /// w_n in rad/s, c/a = w_n^2.
    pub natural_frequency: Scheduled,
    /// zeta of the numerator, b = 2 zeta w_n a.
    pub zero_damping: Scheduled,
    /// zeta of the denominator, d = 2 zeta w_n a.
    pub pole_damping: Scheduled,
    /// w_p in rad/s, the natural frequency of the poles: H = (w_p/w_n)^2 (s^2 + 2 z w_n s + w_n^2)/(s^2 + 2 p w_p s + w_p^2), whose gain at frequency
    /// 0 is 1. `None`: the same as that of the zeros.
    pub pole_frequency: Option<Scheduled>,
}

/// A number of a compensator: constant, or given by surfaces.
#[derive(Debug, Clone, PartialEq)]
pub enum Scheduled {
    /// A constant.
    Fixed(f64),
    /// The value of a surface.
    Surface(String),
    /// The sum of several surfaces.
    Sum(Vec<String>),
}

impl Scheduled {
    /// The number, if it is constant.
    #[must_use]
    pub fn fixed(&self) -> Option<f64> {
        match self {
            Scheduled::Fixed(value) => Some(*value),
            Scheduled::Surface(_) | Scheduled::Sum(_) => None,
        }
    }

    /// The surfaces that give it.
    #[must_use]
    pub fn surfaces(&self) -> &[String] {
        match self {
            Scheduled::Fixed(_) => &[],
            Scheduled::Surface(name) => std::slice::from_ref(name),
            Scheduled::Sum(names) => names,
        }
    }
}

impl Compensator {
    /// The scheduled numbers with their keys in the file.
    #[must_use]
    pub fn parts(&self) -> Vec<(&'static str, &Scheduled)> {
        let mut parts = vec![
            ("natural_frequency", &self.natural_frequency),
            ("zero_damping", &self.zero_damping),
            ("pole_damping", &self.pole_damping),
        ];
        parts.extend(self.pole_frequency.as_ref().map(|scheduled| ("pole_frequency", scheduled)));
        parts
    }

    /// The surfaces that it uses. One that is used twice occurs twice.
    pub fn surfaces(&self) -> impl Iterator<Item = &String> {
        self.parts().into_iter().flat_map(|(_, scheduled)| scheduled.surfaces())
    }
}

impl Model {
    /// The categories of its surfaces, each once.
    #[must_use]
    pub fn categories(&self) -> Vec<&Category> {
        let mut all: Vec<&Category> = Vec::new();
        for category in self.surfaces.iter().flat_map(|surface| &surface.categories) {
            if !all.iter().any(|known| known.name == category.name && known.inputs == category.inputs) {
                all.push(category);
            }
        }
        all
    }

    /// The input with this name.
    #[must_use]
    pub fn input(&self, name: &str) -> Option<&Input> {
        self.inputs.iter().find(|input| input.name == name)
    }

    /// The surface with this name.
    #[must_use]
    pub fn surface(&self, name: &str) -> Option<&Surface> {
        self.surfaces.iter().find(|surface| surface.name == name)
    }
}
