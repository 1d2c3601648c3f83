//! Columns with their properties: an input with its unit and range, a response with the requirements on its surface.
//!
//! In: names, numbers and choices, one method for each. Out: the parts of a specification. They are checked together when the fit is started.

use rsm_core::model::{Category, Coding, Knot, Outside, Sigmoid, Surface, Symmetry, Transform, Wave};

use super::Select;
use crate::missing::is_missing;
use crate::spec::{
    CONTRAST, Constraint, FACES, Form, InputSpec, Loss, MOST_FACES, Method, NoiseOrder, ResponseSpec, SplineSpec, SupportSpec,
    TransformSpec, Weights,
};

/// An input: one value for each row, and its properties.
///
/// ```
/// use rsm_fit::Input;
///
/// let torque = Input::new("torque", [0.0, 5.0, 10.0]).unit("N*m").range([0.0, 12.0]);
/// ```
#[derive(Debug, Clone)]
pub struct Input {
    pub(super) name: Option<String>,
    pub(super) values: Vec<f64>,
    unit: String,
    range: Option<[f64; 2]>,
    outside: Outside,
    period: Option<f64>,
    /// The category of which it is a contrast, with the first text that is no level.
    pub(super) category: Option<(Category, Option<String>)>,
}

impl Input {
    /// An input with one value for each row. The defaults are the unit `1` and the range of the values.
    #[must_use]
    pub fn new(name: impl Into<String>, values: impl AsRef<[f64]>) -> Self {
        Input { name: Some(name.into()), ..Input::unnamed(values.as_ref().to_vec()) }
    }

    /// A category, with one text for each row: an input for each level but the last, which is 1 at its level, -1 at the last level and 0 at the
    /// others. Name them all in [`Response::inputs`], or none.
    ///
    /// ```
    /// use rsm_fit::{Fit, Input};
    ///
    /// let fuel = ["diesel", "petrol", "diesel", "petrol", "diesel", "petrol"];
    /// let mut inputs = Input::category("fuel", ["diesel", "petrol"], fuel);
    /// inputs.push(Input::new("torque", [0.0, 0.0, 1.0, 1.0, 2.0, 2.0]));
    /// let outcome = Fit::new(inputs, &[12.0, 8.0, 15.0, 9.0, 18.0, 10.0]).terms([[0, 0], [1, 0], [0, 1], [1, 1]]).fit()?;
    /// assert_eq!(outcome.model.inputs[0].name, "fuel_diesel");
    /// // The slopes of diesel and petrol are 3 and 1: their mean is 2 for each unit, and 2 for the half range of 1.
    /// assert!((outcome.model.surfaces[0].terms[2].coefficient - 2.0).abs() < 1e-12);
    /// # Ok::<(), rsm_fit::Refused>(())
    /// ```
    #[must_use]
    pub fn category<L: Into<String>, C: AsRef<str>>(
        name: impl Into<String>,
        levels: impl IntoIterator<Item = L>,
        cells: impl IntoIterator<Item = C>,
    ) -> Vec<Self> {
        let category = Category::new(name, levels.into_iter().map(Into::into).collect());
        let cells: Vec<C> = cells.into_iter().collect();
        let columns = category.columns(cells.iter().map(AsRef::as_ref), f64::NAN);
        let is_unknown = |cell: &C| !is_missing(cell.as_ref()) && !category.levels.iter().any(|level| level == cell.as_ref());
        let fault = cells.iter().position(is_unknown).map(|row| {
            let (found, expected) = (cells[row].as_ref(), category.quoted_levels());
            format!("category `{}`: row {}: found `{found}`, expected one of {expected}", category.name, row + 1)
        });
        let input = |(name, values): (&String, Vec<f64>)| Input {
            category: Some((category.clone(), fault.clone())),
            ..Input::new(name.clone(), values).range(CONTRAST)
        };
        category.inputs.iter().zip(columns).map(input).collect()
    }

    pub(super) fn unnamed(values: Vec<f64>) -> Self {
        let (unit, outside) = ("1".to_string(), Outside::default());
        Input { name: None, values, unit, range: None, outside, period: None, category: None }
    }

    /// The unit of the values, as `rsm` spells units: `N*m`, `rad/s`, `degC`. It is kept as text; no value is converted.
    #[must_use]
    pub fn unit(mut self, unit: impl Into<String>) -> Self {
        self.unit = unit.into();
        self
    }

    /// The range of the model, [low, high], in the unit of the values. Rows outside are fitted as measured.
    #[must_use]
    pub fn range(mut self, range: [f64; 2]) -> Self {
        self.range = Some(range);
        self
    }

    /// The values repeat with this period. Readings are converted to one period, from the lower end of the range or from 0.
    #[must_use]
    pub fn period(mut self, period: f64) -> Self {
        self.period = Some(period);
        self
    }

    /// Outside the range an evaluator extrapolates the polynomial, instead of using the nearest bound.
    #[must_use]
    pub fn extrapolated(mut self) -> Self {
        self.outside = Outside::Extrapolate;
        self
    }

    pub(super) fn specification(&self, name: &str) -> InputSpec {
        InputSpec {
            name: name.to_string(),
            column: name.to_string(),
            unit: Some(self.unit.clone()),
            range: self.range,
            outside: self.outside,
            period: self.period,
        }
    }

    pub(super) fn numbers(&self) -> impl Iterator<Item = (String, f64)> {
        let range = self.range.into_iter().flatten().map(|end| ("`range`".to_string(), end));
        range.chain(self.period.map(|period| ("`period`".to_string(), period)))
    }
}

/// A response: one value for each row, and the requirements on its surface.
///
/// Settings that are not given here are those of [`crate::Fit`] or the defaults of a specification.
///
/// ```
/// use rsm_fit::{Constraint, Response, Select};
///
/// let efficiency = Response::new("efficiency", [0.81, 0.88, 0.9])
///     .unit("1")
///     .inputs(["torque"])
///     .select(Select::order(2))
///     .output_range([0.0, 1.0])
///     .constraint(Constraint::Bounds { min: Some(0.0), max: Some(1.0) });
/// ```
#[derive(Debug, Clone)]
pub struct Response {
    pub(super) name: Option<String>,
    pub(super) values: Vec<f64>,
    pub(super) weights: Option<RowWeights>,
    unit: String,
    inputs: Option<Vec<String>>,
    select: Option<Select>,
    surface: Surface,
    constraints: Vec<Constraint>,
    support: Option<SupportSpec>,
    forms: Option<Vec<Form>>,
    spline: Option<SplineSpec>,
    transform: Option<TransformSpec>,
    loss: Loss,
    noise: Option<NoiseOrder>,
}

/// The weights of the rows.
#[derive(Debug, Clone)]
pub(super) enum RowWeights {
    Weights(Vec<f64>),
    StandardErrors(Vec<f64>),
}

impl Response {
    /// A response with one value for each row. The defaults are a surface of all inputs and the unit `1`.
    #[must_use]
    pub fn new(name: impl Into<String>, values: impl AsRef<[f64]>) -> Self {
        Response { name: Some(name.into()), ..Response::unnamed(values.as_ref().to_vec()) }
    }

    pub(super) fn unnamed(values: Vec<f64>) -> Self {
        Response {
            name: None,
            values,
            weights: None,
            unit: "1".to_string(),
            inputs: None,
            select: None,
            surface: Surface::default(),
            constraints: Vec::new(),
            support: None,
            forms: None,
            spline: None,
            transform: None,
            loss: Loss::default(),
            noise: None,
        }
    }

    /// The unit of the values, as text; no value is converted.
    #[must_use]
    pub fn unit(mut self, unit: impl Into<String>) -> Self {
        self.unit = unit.into();
        self
    }

    /// The inputs of this surface, in the order of its arguments and powers. The default is all inputs.
    #[must_use]
    pub fn inputs<T: Into<String>>(mut self, names: impl IntoIterator<Item = T>) -> Self {
        self.inputs = Some(names.into_iter().map(Into::into).collect());
        self
    }

    /// How the terms of this response are chosen, instead of the setting of the fit.
    #[must_use]
    pub fn select(mut self, select: Select) -> Self {
        self.select = Some(select);
        self
    }

    /// The variables of the powers. The default is coded variables from -1 to 1.
    #[must_use]
    pub fn coding(mut self, coding: Coding) -> Self {
        self.surface.coding = coding;
        self
    }

    /// The response is even or odd in this input. The range of the input must be symmetric about 0.
    #[must_use]
    pub fn symmetry(mut self, input: impl Into<String>, symmetry: Symmetry) -> Self {
        self.surface.symmetry.push((input.into(), symmetry));
        self
    }

    /// A hinge: beyond this value of an input the slope may change.
    #[must_use]
    pub fn knot(mut self, input: impl Into<String>, at: f64) -> Self {
        self.surface.knots.push(Knot { input: input.into(), at });
        self
    }

    /// A smooth step: from -1 far below a value of an input to 1 far above, with slope 1/width there.
    #[must_use]
    pub fn sigmoid(mut self, input: impl Into<String>, at: f64, width: f64) -> Self {
        self.surface.sigmoids.push(Sigmoid { input: input.into(), at, width });
        self
    }

    /// Two periodic variables of an input: cosine and sine of this order over this period.
    #[must_use]
    pub fn wave(mut self, input: impl Into<String>, period: f64, order: u32) -> Self {
        self.surface.waves.push(Wave { input: input.into(), period, order });
        self
    }

    /// The allowed forms. The default is powers, and sigmoids if they are clearly better.
    #[must_use]
    pub fn forms(mut self, forms: impl IntoIterator<Item = Form>) -> Self {
        self.forms = Some(forms.into_iter().collect());
        self
    }

    /// A tensor spline over all inputs is the whole surface, in place of terms.
    ///
    /// ```
    /// use rsm_fit::{Fit, Response, spec::SplineSpec};
    ///
    /// let x: Vec<f64> = (0..60).map(|k| f64::from(k) / 59.0).collect();
    /// let y: Vec<f64> = x.iter().map(|x| (9.0 * x).sin()).collect();
    /// let outcome = Fit::new(&x, Response::new("y", y).spline(SplineSpec::default())).fit()?;
    /// assert_eq!(outcome.model.surfaces[0].spline.as_ref().map(|spline| spline.degree), Some(3));
    /// # Ok::<(), rsm_fit::Refused>(())
    /// ```
    #[must_use]
    pub fn spline(mut self, spline: SplineSpec) -> Self {
        self.spline = Some(spline);
        self
    }

    /// The terms describe this transform of the response; the surface returns the response itself.
    ///
    /// ```
    /// use rsm_core::model::Transform;
    /// use rsm_fit::{Fit, Response};
    ///
    /// // A current that grows by the factor e for each volt.
    /// let volts = [0.0, 1.0, 2.0, 3.0];
    /// let current = volts.map(|u: f64| 0.1 * u.exp());
    /// let outcome = Fit::new(&volts, Response::new("i", current).unit("A").transform(Transform::Log)).order(1).fit()?;
    /// assert!((outcome.model.surfaces[0].terms[1].coefficient - 1.5).abs() < 1e-12); // 1 for each volt, 1.5 for the half range
    /// # Ok::<(), rsm_fit::Refused>(())
    /// ```
    #[must_use]
    pub fn transform(mut self, transform: Transform) -> Self {
        self.transform = Some(TransformSpec::Given(transform));
        self
    }

    /// The transform with the largest likelihood, or none (Box, Cox 1964). Every response must be above 0.
    #[must_use]
    pub fn box_cox(mut self) -> Self {
        self.transform = Some(TransformSpec::BoxCox);
        self
    }

    /// An input enters by its reciprocal. Its range must lie on one side of 0.
    #[must_use]
    pub fn reciprocal(mut self, input: impl Into<String>) -> Self {
        self.surface.reciprocal.push(input.into());
        self
    }

    /// The evaluator saturates at these two values, in the unit of the response.
    #[must_use]
    pub fn output_range(mut self, range: [f64; 2]) -> Self {
        self.surface.output_range = Some(range);
        self
    }

    /// One weight for each row, proportional to 1/sigma^2. Only ratios matter.
    #[must_use]
    pub fn weights(mut self, weights: impl AsRef<[f64]>) -> Self {
        self.weights = Some(RowWeights::Weights(weights.as_ref().to_vec()));
        self
    }

    /// The standard error sigma of each row. Only ratios matter.
    #[must_use]
    pub fn standard_errors(mut self, sigma: impl AsRef<[f64]>) -> Self {
        self.weights = Some(RowWeights::StandardErrors(sigma.as_ref().to_vec()));
        self
    }

    /// The loss that the coefficients minimise. The default is least squares.
    ///
    /// ```
    /// use rsm_fit::{Fit, Response, spec::Loss};
    ///
    /// let y = [1.0, 3.0, 5.0, 70.0, 9.0]; // 1 + 2 x with one wrong row
    /// let outcome = Fit::new(&[0.0, 1.0, 2.0, 3.0, 4.0], Response::new("y", y).loss(Loss::L1)).order(1).fit()?;
    /// assert_eq!(outcome.model.surfaces[0].terms[1].coefficient, 4.0); // 2 for each unit, 4 for the half range
    /// # Ok::<(), rsm_fit::Refused>(())
    /// ```
    #[must_use]
    pub fn loss(mut self, loss: Loss) -> Self {
        self.loss = loss;
        self
    }

    /// The errors of a series are autoregressive: each depends on those of the rows before. The fit is one of generalised least squares, with noise
    /// from the same rows. The rows are in the order of time; [`Fit::series`](crate::Fit::series) divides them into series.
    ///
    /// ```
    /// use rsm_fit::{Fit, Response, spec::NoiseOrder};
    ///
    /// let x: Vec<f64> = (0..40).map(|k| f64::from(k % 8)).collect();
    /// let slow = |k: i32| 0.3 * (f64::from(k) / 6.0).sin() + 0.05 * f64::from((7 * k) % 5);
    /// let y: Vec<f64> = x.iter().zip(0..).map(|(x, k)| 1.0 + 2.0 * x + slow(k)).collect();
    /// let outcome = Fit::new(&x, Response::new("y", y).noise(NoiseOrder::Given(1))).order(1).fit()?;
    /// assert!(outcome.statistics("y").unwrap().noise.as_ref().unwrap().coefficients[0] > 0.5);
    /// # Ok::<(), rsm_fit::Refused>(())
    /// ```
    #[must_use]
    pub fn noise(mut self, order: NoiseOrder) -> Self {
        self.noise = Some(order);
        self
    }

    /// A constraint on the surface over its whole supported region. It is proved; otherwise there is no surface.
    #[must_use]
    pub fn constraint(mut self, constraint: Constraint) -> Self {
        self.constraints.push(constraint);
        self
    }

    /// The model contains the region supported by the data: half-spaces that contain all fitted rows, with this margin in coded units.
    #[must_use]
    pub fn supported_by_data(mut self, margin: f64) -> Self {
        self.support = Some(SupportSpec { margin, faces: self.support.map_or(FACES, |support| support.faces) });
        self
    }

    /// For two inputs: the largest number of half-spaces, 8 by default. Used with [`Response::supported_by_data`].
    #[must_use]
    pub fn support_faces(mut self, faces: usize) -> Self {
        let margin = self.support.map_or(0.0, |support| support.margin);
        self.support = Some(SupportSpec { margin, faces });
        self
    }

    /// The specification of this response. `all`: the method of the fit, used if none is given here. `None` if both terms and a method to choose them
    /// were given.
    pub(super) fn specification(&self, name: &str, all: &[InputSpec], select: &Select) -> Option<ResponseSpec> {
        let inputs = self.inputs.clone().unwrap_or_else(|| all.iter().map(|input| input.name.clone()).collect());
        let surface = Surface { name: name.to_string(), unit: self.unit.clone(), inputs, ..self.surface.clone() };
        Some(ResponseSpec {
            column: name.to_string(),
            unit: Some(self.unit.clone()),
            surface,
            method: match (&self.spline, &self.select) {
                (Some(_), None) => Method::Fixed(vec![]),
                _ => self.select.as_ref().unwrap_or(select).method()?,
            },
            weights: self.weights.as_ref().map(|weights| match weights {
                RowWeights::Weights(_) => Weights::Weight("weights in memory".to_string()),
                RowWeights::StandardErrors(_) => Weights::StandardError("standard errors in memory".to_string()),
            }),
            loss: self.loss,
            noise: self.noise,
            constraints: self.constraints.clone(),
            support: self.support,
            forms: self.forms.clone(),
            spline: self.spline.clone(),
            transform: self.transform,
        })
    }

    /// The numbers that must be finite, with their names.
    pub(super) fn numbers(&self) -> impl Iterator<Item = (String, f64)> {
        let range = self.surface.output_range.into_iter().flatten().map(|end| ("`output_range`".to_string(), end));
        let knots = self.surface.knots.iter().enumerate().map(|(k, knot)| (format!("knot {}", k + 1), knot.at));
        let bounds = self.constraints.iter().enumerate().flat_map(|(k, constraint)| {
            let ends = if let Constraint::Bounds { min, max } = constraint { [*min, *max] } else { [None, None] };
            ends.into_iter().flatten().map(move |end| (format!("constraint {}", k + 1), end))
        });
        let margin = self.support.map(|support| ("the margin of the support".to_string(), support.margin));
        let steps = self.surface.sigmoids.iter().enumerate();
        let steps = steps.flat_map(|(k, step)| [step.at, step.width].map(|number| (format!("sigmoid {}", k + 1), number)));
        range.chain(knots).chain(steps).chain(bounds).chain(margin)
    }

    /// Faults that a specification file cannot have, in addition to those of its rules. `inputs`: the number of inputs of the fit.
    pub(super) fn faults(&self, inputs: usize, select: &Select) -> Vec<String> {
        let mut faults = Vec::new();
        faults.extend(self.select.as_ref().unwrap_or(select).faults());
        for (k, (input, _)) in self.surface.symmetry.iter().enumerate() {
            if self.surface.symmetry[..k].iter().any(|(earlier, _)| earlier == input) {
                faults.push(format!("the symmetry of `{input}` is given twice"));
            }
        }
        for (k, constraint) in self.constraints.iter().enumerate() {
            faults.extend(constraint.fault().map(|what| format!("constraint {}: {what}", k + 1)));
        }
        if let Some(support) = self.support.filter(|support| support.margin < 0.0) {
            faults.push(format!("the margin of the support: found {}, expected 0 or more, in coded units", support.margin));
        }
        let inputs = self.inputs.as_ref().map_or(inputs, Vec::len);
        if let Some(support) = self.support.filter(|support| support.faces != FACES) {
            if !(4..=MOST_FACES).contains(&support.faces) {
                let found = support.faces;
                faults.push(format!("the faces of the support: found {found}, expected a whole number from 4 to {MOST_FACES}"));
            }
            if inputs != 2 {
                faults.push("the faces of the support belong to responses of two inputs".to_string());
            }
        }
        faults
    }
}
