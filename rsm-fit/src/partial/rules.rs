//! What a fit of parts can do. A part holds sums of products of terms; everything else of the rows is gone.
//!
//! In: a specification. Out: nothing, or every key that needs rows, with what is possible.

use rsm_core::model::Coding;
use rsm_core::source::{Collector, Fault, Faults};

use crate::left_out;
use crate::spec::{Criterion, Form, Loss, Method, ResponseSpec, Specification, TransformSpec, Validation};

/// The methods that are possible.
const METHODS: &str = "from sums the terms can be given, `select = { method = \"fixed\" }`, or chosen by `criterion = \"aicc\"` with the methods \
                       \"stepwise\", \"best-subset\" and \"lasso\"";

/// Checks that sums hold all that the specification requires.
pub(super) fn check(specification: &Specification) -> Result<(), Faults> {
    let mut faults = Collector::new();
    for (key, rows) in [("validate", &specification.validation), ("test", &specification.test)] {
        if *rows != Validation::None {
            let fault = specification.fault(key, format!("`{key}` needs rows, and a part holds only sums"));
            faults.push(fault.help("leave it out; `rsm diagnose` compares the merged model with other rows"));
        }
    }
    if !specification.blocks.is_empty() {
        let fault = specification.fault("blocks", "`blocks`: which blocks there are depends on the rows of all shards");
        faults.push(fault.help("make the column an input with `categories = [...]` and `additive = true`"));
    }
    for response in &specification.responses {
        check_response(specification, response, &mut faults);
    }
    for (k, input) in specification.inputs.iter().enumerate() {
        let is_used = |response: &&ResponseSpec| left_out::inputs_of(specification, response).contains(&k);
        let needs_range = |response: &&ResponseSpec| {
            response.surface.coding == Coding::Range || response.surface.waves.iter().any(|wave| wave.input == input.name)
        };
        let path = format!("inputs.{}", input.name);
        if input.range.is_none() && specification.responses.iter().filter(is_used).any(|response| needs_range(&response)) {
            let what = format!("input `{}`: without `range` its coding depends on the rows of all shards", input.name);
            let help = "give the range of the model, `range = [low, high]`, or `coding = \"none\"` at the responses";
            faults.push(specification.fault(&path, what).help(help));
        }
        if input.period.is_some() {
            let what = format!("input `{}`: the orders of waves are found on rows, and a part holds only sums", input.name);
            let help = "leave `period` out, and give the response its `waves`";
            faults.push(specification.fault(&format!("{path}.period"), what).help(help));
        }
    }
    faults.finish(Some(()))
}

fn check_response(specification: &Specification, response: &ResponseSpec, faults: &mut Collector) {
    let who = format!("response `{}`", response.surface.name);
    let path = format!("responses.{}", response.surface.name);
    let fault = |key: &str, what: String| -> Fault { specification.fault(&format!("{path}.{key}"), format!("{who}: {what}")) };
    match &response.method {
        Method::Ladder { .. } => {
            let what = "a ladder evaluates its terms on rows, and a part holds only sums".to_string();
            faults.push(fault("select.method", what).help(METHODS));
        }
        Method::Search(search) if search.criterion != Some(Criterion::Aicc) => {
            let criterion = search.criterion.unwrap_or(Criterion::KFold).word();
            let what = format!("criterion \"{criterion}\" evaluates terms on rows, and a part holds only sums");
            faults.push(fault("select.criterion", what).help(METHODS));
        }
        _ => {}
    }
    if response.spline.is_some() {
        let what = "the penalty of a spline is chosen on rows, and a part holds only sums".to_string();
        faults.push(fault("spline", what).help("give `terms` or `order` with `select = { method = \"fixed\" }`"));
    }
    if response.transform == Some(TransformSpec::BoxCox) {
        let what = "\"box-cox\" compares errors of rows, and a part holds only sums".to_string();
        faults.push(fault("transform", what).help("give the transform, for example `transform = \"log\"`"));
    }
    let tries = |form| match &response.forms {
        Some(forms) => forms.contains(&form),
        // A search tries sigmoids without a request.
        None => form == Form::Sigmoid && matches!(response.method, Method::Search(_)),
    };
    if [Form::Hinge, Form::Sigmoid, Form::Wave, Form::Spline].into_iter().any(tries) {
        let what = "hinges, sigmoids, waves and splines are found on rows, and a part holds only sums".to_string();
        faults
            .push(fault("forms", what).help("write `forms = [\"polynomial\"]`; `knots`, `sigmoids` and `waves` may be given"));
    }
    if response.noise.is_some() {
        let what = "autoregressive errors relate each row to the rows before, and a part holds only sums".to_string();
        faults.push(fault("noise", what).help("fit the rows of the series in one fit"));
    }
    if response.loss != Loss::LeastSquares {
        let what = format!("`loss = \"{}\"` weights each row by its error, and a part holds only sums", response.loss.word());
        faults.push(fault("loss", what).help("from sums only least squares is possible"));
    }
    if response.support.is_some() {
        let what = "`support` is found on rows, and a part holds only sums".to_string();
        faults.push(fault("support", what).help("leave it out; the ranges of the inputs limit the model"));
    }
}
