//! The evidence for a surface, as it is written into the model file.
//!
//! In: the specification, the outcome and the records of one response. Out: named pieces of evidence: data files with hashes, the specification with
//! its hash, the method, the figures of quality. It contains no path, date or user name, so the same inputs give the same text.

use rsm_core::model::{Evidence, Surface};
use rsm_core::source::Source;

use crate::constrain::{ConstraintReport, ConstraintStatistics};
use crate::left_out::LeftOut;
use crate::observations::{Named, ValidationStatistics};
use crate::outcome::ResponseOutcome;
use crate::records::{DataFile, Records, hash};
use crate::selection::ChosenBy;
use crate::spec::{Form, Loss, Method, ResponseSpec, Specification, Validation, Weights};

/// The evidence of a fitted response.
#[must_use]
pub(crate) fn of(
    specification: &Specification,
    response: &ResponseSpec,
    outcome: &ResponseOutcome,
    left_out: &[LeftOut],
    [fit, validate, test]: [Option<&Records>; 3],
) -> Vec<(String, Evidence)> {
    let Some(statistics) = &outcome.statistics else { return Vec::new() };
    let mut evidence = Vec::new();
    let mut tell = |name: &str, value: Option<Evidence>| evidence.extend(value.map(|value| (name.to_string(), value)));
    let number = |value: Option<f64>| value.map(Evidence::Number);
    tell("rows", Some(whole(statistics.rows)));
    tell("rows_outside_range", Some(whole(outcome.rows_outside)).filter(|_| outcome.rows_outside > 0));
    for one in left_out.iter().filter(|one| one.key == "data") {
        tell("rows_left_out", Some(whole(one.rows)));
    }
    tell("data", fit.map(|fit| files(&fit.files)));
    tell("specification", specification.source().map(file_of));
    let of_spline = statistics.spline.as_ref().map(|spline| spline.words());
    tell("method", Some(Evidence::Text(of_spline.unwrap_or_else(|| method(response)))));
    if let Some(transform) = statistics.transform.as_ref().filter(|it| it.transform != "none") {
        tell("transform", Some(Evidence::Text(transform.words())));
        tell("rmse", transform.fitted.as_ref().map(|fitted| Evidence::Number(fitted.rmse)));
    }
    tell(
        "weights",
        response.weights.as_ref().map(|weights| {
            Evidence::Text(match weights {
                Weights::Weight(column) => format!("column {column}"),
                Weights::StandardError(column) => format!("1/{column}^2"),
            })
        }),
    );
    if let Some(noise) = &statistics.noise {
        tell("noise", Some(Evidence::Text(noise.words())));
    }
    if let Some(loss) = &statistics.loss {
        tell("error_scale", Some(Evidence::Number(loss.scale)));
    }
    if let Some(blocks) = &statistics.blocks {
        let columns = Evidence::List(blocks.columns.iter().cloned().map(Evidence::Text).collect());
        let count = ("count".to_string(), whole(blocks.effects.len()));
        let sd = ("sd".to_string(), Evidence::Number(blocks.sd));
        tell("blocks", Some(Evidence::Table(vec![("columns".to_string(), columns), count, sd])));
    }
    tell("residual_sd", number(statistics.residual_sd));
    tell("r2", number(statistics.r2));
    tell("r2_predicted", number(statistics.r2_predicted));
    tell("press", number(statistics.press));
    tell("confidence_c", number(statistics.confidence_c));
    if outcome.chosen_by != ChosenBy::Nobody {
        tell("terms_chosen_on", Some(Evidence::Text(outcome.chosen_by.words().to_string())));
    }
    if let Some(forms) = statistics.forms.as_ref().filter(|forms| forms.chosen != Form::Polynomial) {
        tell("form", Some(Evidence::Text(forms.words())));
    }
    if let Some(constraints) = &statistics.constraints {
        tell("constraints", Some(constrained(constraints)));
    }
    if let Some(support) = &statistics.support {
        let mut table = vec![("share_of_box".to_string(), Evidence::Number(support.share_of_box))];
        table.extend(validate.or(test).map(|_| ("unseen_rows_outside".to_string(), whole(support.unseen_rows_outside))));
        tell("support", Some(Evidence::Table(table)));
    }
    if let (Some(validation), Some(records)) = (&statistics.validation, validate) {
        let mut table = apart(&specification.validation, records, validation);
        if outcome.chosen_by == ChosenBy::Validation {
            table.push(text("errors", "on the rows that chose it"));
        }
        tell("validation", Some(Evidence::Table(table)));
    }
    if let (Some(judged), Some(records)) = (&statistics.test, test) {
        tell("test", Some(Evidence::Table(apart(&specification.test, records, judged))));
    }
    if let Some(cross) = &statistics.cross_validation {
        let mut table = vec![("parts".to_string(), whole(cross.parts))];
        table.extend(errors(&cross.errors));
        table.extend(cross.r2.map(|r2| ("r2".to_string(), Evidence::Number(r2))));
        tell("cross_validation", Some(Evidence::Table(table)));
    }
    evidence
}

/// The source of rows that were set aside, and the errors on them.
fn apart(rows: &Validation, records: &Records, judged: &ValidationStatistics) -> Vec<(String, Evidence)> {
    let source = match rows {
        Validation::Split(split) => Evidence::Text(format!("a share of {} of the data, seed {}", split.share, split.seed)),
        _ => files(&records.files),
    };
    let mut table = vec![("data".to_string(), source), ("rows".to_string(), whole(judged.rows))];
    table.extend(errors(judged).filter(|(name, _)| name != "rows"));
    table
}

fn errors(judged: &ValidationStatistics) -> impl Iterator<Item = (String, Evidence)> {
    let figures = [
        ("rows", Some(whole(judged.rows))),
        ("mean_abs_error", Some(Evidence::Number(judged.mean_abs_error))),
        ("max_abs_error", Some(Evidence::Number(judged.max_abs_error))),
        ("rmse", Some(Evidence::Number(judged.rmse))),
        ("confidence_c", judged.confidence_c.map(Evidence::Number)),
    ];
    figures.into_iter().filter_map(|(name, value)| Some((name.to_string(), value?)))
}

pub(crate) fn whole(count: usize) -> Evidence {
    Evidence::Whole(i64::try_from(count).unwrap_or(i64::MAX))
}

fn text(name: &str, value: &str) -> (String, Evidence) {
    (name.to_string(), Evidence::Text(value.to_string()))
}

fn files(files: &[DataFile]) -> Evidence {
    let of_one = |file: &DataFile| {
        let rows = ("rows".to_string(), whole(file.rows));
        Evidence::Table(vec![text("file", &file.name), rows, text("sha256", &file.sha256)])
    };
    Evidence::List(files.iter().map(of_one).collect())
}

/// What was proven about the surface, and the increase of its error.
fn constrained(told: &ConstraintStatistics) -> Evidence {
    let number = |name: &str, value: f64| (name.to_string(), Evidence::Number(value));
    let of_one = |report: &ConstraintReport| {
        let mut table = vec![text("constraint", &report.constraint), number("proven_distance", report.distance)];
        let point = |point: &Named<f64>| Evidence::Table(point.0.iter().map(|(name, value)| number(name, *value)).collect());
        if !report.points.is_empty() {
            table.push(("holds_the_surface_at".to_string(), Evidence::List(report.points.iter().map(point).collect())));
        }
        Evidence::Table(table)
    };
    let list = Evidence::List(told.constraints.iter().map(of_one).collect());
    let mut table = vec![("active".to_string(), Evidence::Flag(told.active)), ("each".to_string(), list)];
    if let Some(change) = &told.largest_change {
        table.extend(told.residual_sd_without.map(|sd| number("residual_sd_without", sd)));
        table.extend(told.validation_without.as_ref().map(|unseen| number("unseen_rmse_without", unseen.rmse)));
        table.push(number("largest_change", change.value));
    }
    Evidence::Table(table)
}

/// The residual standard deviation in the evidence of a surface.
#[must_use]
pub fn residual_sd_of(surface: &Surface) -> Option<f64> {
    surface.evidence.iter().find_map(|(name, value)| match value {
        Evidence::Number(sd) if name == "residual_sd" => Some(*sd),
        _ => None,
    })
}

/// A file with its hash. The file name has no folders, because the folder is specific to one machine.
pub(crate) fn file_of(source: &Source) -> Evidence {
    let name = source.name().rsplit(['/', '\\']).next().unwrap_or_default();
    Evidence::Table(vec![text("file", name), text("sha256", &hash(source.text()))])
}

fn method(response: &ResponseSpec) -> String {
    let by = match response.loss {
        Loss::LeastSquares if response.noise.is_some() => "generalised least squares",
        Loss::LeastSquares => "least squares",
        Loss::Huber => "Huber's loss",
        Loss::L1 => "least absolute errors",
    };
    match &response.method {
        Method::Ladder { max_order, confidence } => format!("ladder up to order {max_order}, confidence {confidence} % wanted"),
        Method::Fixed(terms) => format!("{by} on {} given terms", terms.len()),
        Method::FixedOrder(order) => format!("{by} on all terms up to order {order}"),
        Method::Search(search) => format!("{} up to order {}", search.by.word(), search.max_order),
    }
}
