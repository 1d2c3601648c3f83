//! The forms of a surface: coding, symmetry, hinges, sigmoids, waves, categories, splines, transforms. Plain data without checks.

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
