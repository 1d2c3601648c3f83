//! The key `transform` of a response.
//!
//! In: the table of a response. Out: a [`TransformSpec`]; then, with the response, faults if they do not fit together. Data are not used.

use rsm_core::model::{Outside, Symmetry, Transform};
use rsm_core::model_file;
use rsm_core::places::Places;
use rsm_core::source::Collector;
use rsm_core::toml_reader::TableReader;

use super::{Constraint, Loss, ResponseSpec, Specification, TransformSpec};

pub(super) fn check(specification: &Specification, faults: &mut Collector) {
    specification.responses.iter().for_each(|response| check_response(specification, response, faults));
}

/// Reads `transform`: a name of a model file, or "box-cox". `Some(None)` if the key is absent.
pub(super) fn read(
    path: &str,
    reader: &mut TableReader<'_>,
    places: &mut Places,
    faults: &mut Collector,
) -> Option<Option<TransformSpec>> {
    let given = Transform::ALL.map(|transform| (transform.word(), TransformSpec::Given(transform)));
    let names = [&given[..], &[(TransformSpec::BOX_COX, TransformSpec::BoxCox)]].concat();
    model_file::read_transform(path, &names, reader, places, faults)
}

/// A transform must have the constraints and inputs of its response; "box-cox" compares squared errors of independent rows.
fn check_response(specification: &Specification, response: &ResponseSpec, faults: &mut Collector) {
    let Some(wanted) = response.transform else { return };
    let name = &response.surface.name;
    let mut fault = |what: String, help: &str| {
        let what = format!("response `{name}`: `transform` {what}");
        faults.push(specification.fault(&format!("responses.{name}.transform"), what).help(help));
    };
    if response.constraints.iter().any(|constraint| matches!(constraint, Constraint::Convex | Constraint::Concave)) {
        let help = "use \"bounds\" and \"monotone\", or no transform";
        fault("cannot be combined with a convex or concave response: the constraint would be on its terms".into(), help);
    }
    if let Some((input, _)) = response.surface.symmetry.iter().find(|(_, symmetry)| *symmetry == Symmetry::Odd) {
        let help = "an odd response changes its sign, and a transform keeps it: use \"even\", or no transform";
        fault(format!("cannot be combined with the odd input `{input}`"), help);
    }
    let TransformSpec::Given(transform) = wanted else {
        if response.noise.is_some() || response.loss != Loss::LeastSquares {
            let help = "give the transform, or fit by least squares without `noise`";
            fault(
                "\"box-cox\" compares squared errors of independent rows: it needs the default `loss` and no `noise`".into(),
                help,
            );
        }
        return;
    };
    let extrapolates = |input: &&String| specification.input(input).is_some_and(|it| it.outside == Outside::Extrapolate);
    if let Some(input) = response.surface.inputs.iter().find(extrapolates).filter(|_| transform.needs_positive()) {
        let what = format!("\"{}\": `{input}` extrapolates, and nothing keeps the terms above 0 there", transform.word());
        fault(what, "use outside = \"clamp\", or another transform");
    }
    for (k, constraint) in response.constraints.iter().enumerate() {
        let Constraint::Bounds { min, max } = constraint else { continue };
        for bound in [min, max].into_iter().flatten().filter(|bound| transform.transformed(**bound).is_none()) {
            let (word, accepted) = (transform.word(), transform.accepted());
            let what =
                format!("response `{name}`: constraint {}: found {bound}, and `transform` \"{word}\" needs {accepted}", k + 1);
            let fault = specification.fault(&format!("responses.{name}.constraints.{k}"), what);
            faults.push(fault.help("leave out a bound that every response after this transform keeps"));
        }
    }
}
