//! The parts of a model: inputs with ranges, surfaces with terms, compensators. Plain data without checks.
//!
//! Read from a file by [`crate::model_file`], created by the fitter, checked by [`crate::check`]. The exact value of a surface is the real polynomial
//! with exactly these f64 coefficients and exact coded variables.

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

/// The variables of the powers of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Coding {
    /// Coded variables x = (xi - mid)/half, (22), (23).
    #[default]
    Range,
    /// The natural variables themselves.
    None,
}

/// The symmetry of a response when an input changes sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Symmetry {
    /// y(-xi) = y(xi).
    Even,
    /// y(-xi) = -y(xi).
    Odd,
}

/// A transform of a response.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Transform {
    /// The terms describe sqrt y.
    SquareRoot,
    /// The terms describe the cube root of y, which is negative for a negative y.
    CubeRoot,
    /// The terms describe y^(1/4).
    FourthRoot,
    /// The terms describe the natural logarithm of y.
    Log,
    /// The terms describe 1/sqrt y.
    ReciprocalSquareRoot,
    /// The terms describe 1/y.
    Reciprocal,
}

impl Transform {
    /// All of them, from weak to strong.
    pub const ALL: [Transform; 6] = [
        Transform::SquareRoot,
        Transform::CubeRoot,
        Transform::FourthRoot,
        Transform::Log,
        Transform::ReciprocalSquareRoot,
        Transform::Reciprocal,
    ];

    /// The name in files.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Transform::SquareRoot => "square-root",
            Transform::CubeRoot => "cube-root",
            Transform::FourthRoot => "fourth-root",
            Transform::Log => "log",
            Transform::ReciprocalSquareRoot => "reciprocal-square-root",
            Transform::Reciprocal => "reciprocal",
        }
    }

    /// The power lambda of Box and Cox.
    #[must_use]
    pub fn lambda(self) -> f64 {
        match self {
            Transform::SquareRoot => 0.5,
            Transform::CubeRoot => 1.0 / 3.0,
            Transform::FourthRoot => 0.25,
            Transform::Log => 0.0,
            Transform::ReciprocalSquareRoot => -0.5,
            Transform::Reciprocal => -1.0,
        }
    }

    /// A quantity after the transform, in words: `log(torque)`.
    #[must_use]
    pub fn words(self, what: &str) -> String {
        match self {
            Transform::SquareRoot => format!("sqrt({what})"),
            Transform::CubeRoot => format!("cbrt({what})"),
            Transform::FourthRoot => format!("({what})^(1/4)"),
            Transform::Log => format!("log({what})"),
            Transform::ReciprocalSquareRoot => format!("1/sqrt({what})"),
            Transform::Reciprocal => format!("1/({what})"),
        }
    }

    /// Whether the response falls where P rises.
    #[must_use]
    pub fn is_falling(self) -> bool {
        self.needs_positive()
    }

    /// Whether P must be above 0 in the whole box.
    #[must_use]
    pub fn needs_positive(self) -> bool {
        matches!(self, Transform::ReciprocalSquareRoot | Transform::Reciprocal)
    }
}

/// A hinge of an input at a natural value.
#[derive(Debug, Clone, PartialEq)]
pub struct Knot {
    /// The input.
    pub input: String,
    /// The natural value of the knot.
    pub at: f64,
}

/// A sigmoid of an input: from -1 far below a natural value to 1 far above it, with slope 1/width there.
///
/// With s = (xi - at)/width: u = s (1 + |s|)/(1 + |s| + s^2). For a symmetric input |xi| replaces xi, and the value at 0 is subtracted.
#[derive(Debug, Clone, PartialEq)]
pub struct Sigmoid {
    /// The input.
    pub input: String,
    /// The natural value at which it is 0.
    pub at: f64,
    /// At `at + width` it is 2/3.
    pub width: f64,
}

/// Two periodic variables of an input: cosine and sine of 2 pi order (xi - middle)/period, with the middle of its range.
///
/// Computed by polynomials of one turn and products of them, with an error below 10^-15 (order + 1): see [`crate::basis`].
#[derive(Debug, Clone, PartialEq)]
pub struct Wave {
    /// The input. It must clamp, and its range must be at most one period.
    pub input: String,
    /// The period of order 1, in the unit of the input.
    pub period: f64,
    /// The number of waves in a period, 1 to 1000.
    pub order: u32,
}

/// A category, such as a fuel or a gear box, in effect coding: each level but the last has an input, its contrast.
///
/// At its level a contrast is 1, at the last level all contrasts are -1, and at every other level a contrast is 0. With all contrasts at 0 the
/// surface is the mean over the levels (Draper, Smith 1998, Applied Regression Analysis, chapter 14).
///
/// ```
/// use rsm_core::model::Category;
///
/// let levels = ["diesel", "gas", "petrol"].map(String::from).to_vec();
/// let fuel = Category::new("fuel", levels);
/// assert_eq!(fuel.inputs, ["fuel_diesel", "fuel_gas"]);
/// assert_eq!(fuel.contrasts("gas"), Some(vec![0.0, 1.0]));
/// assert_eq!(fuel.contrasts("petrol"), Some(vec![-1.0, -1.0]));
/// assert_eq!(fuel.contrasts("coal"), None);
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Category {
    /// Its name, that of the column of texts.
    pub name: String,
    /// The texts of the levels.
    pub levels: Vec<String>,
    /// The input of each level but the last.
    pub inputs: Vec<String>,
    /// Whether a level only shifts the response: its contrasts are in every model of a fit, and in no product with another input.
    pub additive: bool,
}

impl Category {
    /// A category with the usual names of its inputs: its name, then the letters and digits of the level, with `_` between them.
    #[must_use]
    pub fn new(name: impl Into<String>, levels: Vec<String>) -> Self {
        let name = name.into();
        let input = |(k, level): (usize, &String)| {
            let lower = level.to_lowercase();
            let parts: Vec<&str> =
                lower.split(|at: char| !at.is_ascii_alphanumeric()).filter(|part| !part.is_empty()).collect();
            if parts.is_empty() { format!("{name}_level_{}", k + 1) } else { format!("{name}_{}", parts.join("_")) }
        };
        let inputs = levels.iter().take(levels.len().saturating_sub(1)).enumerate().map(input).collect();
        Category { name, levels, inputs, additive: false }
    }

    /// The values of its inputs at a level; `None` if it has no such level.
    #[must_use]
    pub fn contrasts(&self, level: &str) -> Option<Vec<f64>> {
        let place = self.levels.iter().position(|known| known == level)?;
        Some((0..self.inputs.len()).map(|input| self.contrast(place, input)).collect())
    }

    /// The values of its inputs in rows with these levels, a column for each input; `otherwise` in a row whose level it does not have.
    #[must_use]
    pub fn columns<'a>(&self, rows: impl IntoIterator<Item = &'a str>, otherwise: f64) -> Vec<Vec<f64>> {
        let mut columns = vec![Vec::new(); self.inputs.len()];
        for level in rows {
            let place = self.levels.iter().position(|known| known == level);
            for (k, column) in columns.iter_mut().enumerate() {
                column.push(place.map_or(otherwise, |place| self.contrast(place, k)));
            }
        }
        columns
    }

    /// The value of an input at a level, both by their places.
    fn contrast(&self, level: usize, input: usize) -> f64 {
        if level + 1 == self.levels.len() { -1.0 } else { f64::from(u8::from(level == input)) }
    }

    /// Whether one of its inputs is among these names.
    #[must_use]
    pub fn is_in(&self, names: &[String]) -> bool {
        self.inputs.iter().any(|input| names.contains(input))
    }

    /// The levels for a message: `` `diesel`, `petrol` ``.
    #[must_use]
    pub fn quoted_levels(&self) -> String {
        self.levels.iter().map(|level| format!("`{level}`")).collect::<Vec<_>>().join(", ")
    }

    /// The meaning of one of its inputs in words: `1 for diesel, -1 for petrol, 0 for the other levels of fuel`.
    #[must_use]
    pub fn words(&self, input: usize) -> String {
        let [level, last] = [input, self.levels.len() - 1].map(|k| &self.levels[k]);
        let others = if self.levels.len() > 2 { format!(", 0 for the other levels of {}", self.name) } else { String::new() };
        format!("1 for {level}, -1 for {last}{others}")
    }
}

/// A tensor spline over all inputs of a surface, on uniform knots: degree 1 is a table with (bi)linear interpolation, degree 3 has continuous second
/// derivatives.
///
/// With t = cells (xi - low)/(high - low) of an input, the basis function i has the support from t = i - degree to i + 1. The surface is the sum
/// over all products of basis functions, one of each input, times their coefficients.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    /// 1 or 3.
    pub degree: u32,
    /// The number of cells along each input, in the order of the surface's inputs.
    pub cells: Vec<u32>,
    /// One for each product, in the unit of the response: `cells` + `degree` along each input, those of the last input change fastest.
    pub coefficients: Vec<f64>,
}

impl Spline {
    /// The number of basis functions along each input.
    #[must_use]
    pub fn counts(&self) -> Vec<usize> {
        self.cells.iter().map(|cells| (cells + self.degree) as usize).collect()
    }

    /// The distance in `coefficients` between neighbours along each input.
    #[must_use]
    pub fn strides(&self) -> Vec<usize> {
        let counts = self.counts();
        (0..counts.len()).map(|k| counts[k + 1..].iter().product()).collect()
    }

    /// Its kind and size in words.
    #[must_use]
    pub fn words(&self) -> String {
        let cells: Vec<String> = self.cells.iter().map(u32::to_string).collect();
        let what = match (self.degree, self.cells.len()) {
            (1, 1) => "table, linear between its points",
            (1, _) => "table, linear along each input between its points",
            (_, 1) => "cubic spline",
            _ => "tensor product of cubic splines",
        };
        format!("{what}, {} cells", cells.join(" x "))
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
