//! Responses and their exact gradients over the operating limits, in coded variables from -1 to 1.
//!
//! In: a checked model, the names of responses, the limits of inputs. Out: values with the bits of the evaluators, gradients by the tangent of the
//! same tape. Beyond the range of a clamped input and at a saturated output a gradient is 0, as the evaluator is flat there.

use rsm_core::check::Checked;
use rsm_core::lower;
use rsm_core::model::Input;
use rsm_core::number::Precision;
use rsm_core::run::Interpreter;
use rsm_core::tape::Tape;

use super::pieces::Piece;
use crate::design::Physical;
use crate::support::Region;

/// A gradient is taken at least this part of the range inside an end: beyond the end a clamp makes it 0.
const INSIDE: f64 = 1e-9;

/// The step of the differences of coded variables, in half ranges. They are smooth formulas of one input.
const DIFFERENCE: f64 = 1e-5;

/// Responses over a box of operating limits.
pub(super) struct Surfaces<'a> {
    checked: &'a Checked,
    /// The inputs that the responses use, in the order of the model.
    pub inputs: Vec<Input>,
    /// The operating limits of each; equal for an input that is held.
    pub limits: Vec<[f64; 2]>,
    /// The inputs that may change, in order: the coded variables.
    pub free: Vec<usize>,
    responses: Vec<Response>,
}

struct Response {
    index: usize,
    /// For each input of the surface, its place among the inputs.
    places: Vec<usize>,
    value: Tape,
    gradient: Tape,
}

impl<'a> Surfaces<'a> {
    /// `names` are surfaces of the model, `limits` finite numbers within the ranges.
    pub(super) fn new(checked: &'a Checked, names: &[&str], limits: &dyn Fn(&Input) -> [f64; 2]) -> Surfaces<'a> {
        let model = checked.model();
        let indices: Vec<usize> =
            names.iter().filter_map(|name| model.surfaces.iter().position(|surface| surface.name == *name)).collect();
        let is_used = |input: &&Input| indices.iter().any(|index| model.surfaces[*index].inputs.contains(&input.name));
        let inputs: Vec<Input> = model.inputs.iter().filter(is_used).cloned().collect();
        let response = |index: &usize| {
            let place = |name: &String| inputs.iter().position(|input| input.name == *name);
            Response {
                index: *index,
                places: model.surfaces[*index].inputs.iter().filter_map(place).collect(),
                value: lower::surface(checked, *index, Precision::F64),
                gradient: lower::gradient(checked, *index, Precision::F64),
            }
        };
        let responses = indices.iter().map(response).collect();
        let limits: Vec<[f64; 2]> = inputs.iter().map(limits).collect();
        let free = (0..inputs.len()).filter(|k| limits[*k][0] < limits[*k][1]).collect();
        Surfaces { checked, inputs, limits, free, responses }
    }

    /// The settings of a coded point, exact at the ends.
    pub(super) fn settings(&self, coded: &[f64]) -> Vec<f64> {
        let mut settings: Vec<f64> = self.limits.iter().map(|[low, _]| *low).collect();
        for (place, x) in self.free.iter().zip(coded) {
            let [low, high] = self.limits[*place];
            // The weights sum to 1, and at -1 and 1 one of them is 0.
            settings[*place] = (low * ((1.0 - x) / 2.0) + high * ((1.0 + x) / 2.0)).clamp(low, high);
        }
        settings
    }

    /// The change of each setting for a change of its coded variable by 1.
    pub(super) fn half(&self, input: usize) -> f64 {
        0.5 * (self.limits[input][1] - self.limits[input][0])
    }

    /// The coded variable of an input; `None` if it is held.
    pub(super) fn variable(&self, input: usize) -> Option<usize> {
        self.free.iter().position(|place| *place == input)
    }

    /// The unit of a response.
    pub(super) fn unit(&self, response: usize) -> &str {
        &self.checked.model().surfaces[self.responses[response].index].unit
    }

    /// A response at settings.
    pub(super) fn value(&self, response: usize, settings: &[f64]) -> f64 {
        let it = &self.responses[response];
        let arguments: Vec<f64> = it.places.iter().map(|place| settings[*place]).collect();
        Interpreter::<f64>::new(&it.value).eval(&arguments)
    }

    /// All responses with their gradients with respect to the coded variables.
    pub(super) fn responses(&self, coded: &[f64]) -> Vec<Piece> {
        let settings = self.settings(coded);
        let of_one = |(k, it): (usize, &Response)| {
            let inside = |place: &usize| {
                let [low, high] = self.inputs[*place].range;
                let margin = INSIDE * (high - low);
                settings[*place].clamp(low + margin, high - margin)
            };
            let arguments: Vec<f64> = it.places.iter().map(inside).collect();
            let mut interpreter = Interpreter::<f64>::new(&it.gradient);
            interpreter.step(&arguments);
            let mut gradient = vec![0.0; coded.len()];
            for (place, slope) in it.places.iter().zip(interpreter.results()) {
                if let Some(variable) = self.variable(*place) {
                    gradient[variable] += slope * self.half(*place);
                }
            }
            Piece { value: self.value(k, &settings), gradient }
        };
        self.responses.iter().enumerate().map(of_one).collect()
    }

    /// The half-spaces of all supports, normal . x - bound, each with the name of its surface. At most 0 inside.
    pub(super) fn supports(&self, coded: &[f64]) -> Vec<(&str, Piece)> {
        let mut pieces = Vec::new();
        for it in &self.responses {
            let surface = &self.checked.model().surfaces[it.index];
            if surface.support.is_empty() {
                continue;
            }
            let region = Region::new(surface, &self.checked.inputs_of(surface));
            let at = |coded: &[f64]| -> Vec<f64> {
                let settings = self.settings(coded);
                let point: Vec<Physical> = it.places.iter().map(|place| Physical(settings[*place])).collect();
                region.coded(&point).iter().map(|x| x.to_f64()).collect()
            };
            let here = at(coded);
            let slope = |(k, place): (usize, &usize)| {
                let variable = self.variable(*place)?;
                let (mut below, mut above) = (coded.to_vec(), coded.to_vec());
                below[variable] = (coded[variable] - DIFFERENCE).max(-1.0);
                above[variable] = (coded[variable] + DIFFERENCE).min(1.0);
                Some((variable, (at(&above)[k] - at(&below)[k]) / (above[variable] - below[variable])))
            };
            let slopes: Vec<Option<(usize, f64)>> = it.places.iter().enumerate().map(slope).collect();
            for space in &surface.support {
                let mut gradient = vec![0.0; coded.len()];
                for (slope, normal) in slopes.iter().zip(&space.normal) {
                    if let Some((variable, slope)) = slope {
                        gradient[*variable] += normal * slope;
                    }
                }
                let sum: f64 = space.normal.iter().zip(&here).map(|(normal, x)| normal * x).sum();
                pieces.push((surface.name.as_str(), Piece { value: sum - space.bound, gradient }));
            }
        }
        pieces
    }
}
