//! The JSON of causes and errors, the same for a surface and for a plant (docs/book/src/reference/formats.md 4.3).
//!
//! In: the results for a cause, in the types of its diagnosis. Out: values, with the keys in one order. A number that is not finite becomes null.

use serde_json::{Map, Value, json};

use crate::output::finite;

/// Keys with their values.
pub(super) type Keys = Vec<(&'static str, Value)>;

/// A cause.
pub(super) struct CauseJson<'a> {
    /// The kind.
    pub(super) kind: &'a str,
    /// The keys that identify the cause in addition to its kind: the response of a surface, with its subject.
    pub(super) place: Keys,
    /// Its parameters by name.
    pub(super) numbers: Vec<(String, Value)>,
    /// Further keys of this kind of cause.
    pub(super) details: Keys,
    /// The probability that it is right.
    pub(super) confidence: f64,
    /// The probability that it, or a cause that cannot be distinguished from it, is right.
    pub(super) confidence_of_any: f64,
    /// The causes that cannot be distinguished from it.
    pub(super) indistinguishable_from: &'a [String],
    /// The last keys: regions, evidence, sentences.
    pub(super) evidence: Keys,
}

impl CauseJson<'_> {
    /// The cause as JSON.
    pub(super) fn value(self) -> Value {
        let mut object: Map<String, Value> = Map::new();
        let mut add = |keys: Keys| object.extend(keys.into_iter().map(|(key, value)| (key.to_string(), value)));
        add(vec![("kind", json!(self.kind))]);
        add(self.place);
        add(vec![("parameters", Value::Object(self.numbers.into_iter().collect()))]);
        add(self.details);
        add(vec![
            ("confidence", json!(finite(self.confidence))),
            ("confidence_of_any", json!(finite(self.confidence_of_any))),
            ("indistinguishable_from", json!(self.indistinguishable_from)),
        ]);
        add(self.evidence);
        Value::Object(object)
    }
}

/// An estimate with its interval.
pub(super) fn number(value: f64, low: f64, high: f64, unit: &str) -> Value {
    json!({ "value": finite(value), "low": finite(low), "high": finite(high), "unit": unit })
}

/// Rivals, each with the difference of its gain.
pub(super) fn rivals(list: &[(String, f64)]) -> Value {
    list.iter().map(|(label, behind)| json!({ "cause": label, "behind": finite(*behind) })).collect()
}

/// Errors of an output or a response.
pub(super) fn error(rmse: f64, noise_ratio: f64) -> Value {
    json!({ "rmse": finite(rmse), "noise_ratio": finite(noise_ratio) })
}

/// Errors by name: on the rows that choose the causes, and on test rows if there are any.
pub(super) fn errors(
    validate: impl Iterator<Item = (String, Value)>,
    test: Option<impl Iterator<Item = (String, Value)>>,
) -> Value {
    let mut value = json!({ "validate": validate.collect::<Map<String, Value>>() });
    if let Some(test) = test {
        value["test"] = Value::Object(test.collect());
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_has_its_keys_in_one_order_and_null_for_what_is_no_number() {
        let cause_json = CauseJson {
            kind: "sensor-bias",
            place: vec![("output", json!("speed"))],
            numbers: vec![("bias".to_string(), number(1.0, f64::NEG_INFINITY, 2.0, "rad/s"))],
            details: Vec::new(),
            confidence: 0.5,
            confidence_of_any: f64::NAN,
            indistinguishable_from: &[],
            evidence: vec![("rivals", rivals(&[("sensor-gain".to_string(), 3.0)]))],
        };
        assert_eq!(
            cause_json.value().to_string(),
            r#"{"kind":"sensor-bias","output":"speed","parameters":{"bias":{"value":1.0,"low":null,"high":2.0,"unit":"rad/s"}},"confidence":0.5,"confidence_of_any":null,"indistinguishable_from":[],"rivals":[{"cause":"sensor-gain","behind":3.0}]}"#
        );
    }
}
