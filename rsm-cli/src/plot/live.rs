//! The numbers of an interactive plot, for the page's script.
//!
//! In: series, a surface. Out: JSON. Numbers have the digits that a plot can show. A curve of many points is reduced to its extremes.

use serde_json::{Map as Object, Value, json};

use super::{CELLS, Map, Mark, Series, Words, along, finite, name_of, thinned};

/// The largest number of points of one line: two for each pixel of a wide screen. A zoom then shows coarse data; a separate plot of the worst section
/// has all its rows.
const MOST_POINTS: usize = 3000;

/// The same for a line of a group of which only one line is shown at a time.
const FEW_POINTS: usize = 600;

/// Significant digits of a number in a plot.
const DIGITS: usize = 7;

/// Curves over two axes.
pub fn curves(words: &Words<'_>, series: &[Series], decades: bool) -> Value {
    let shown = |point: &&(f64, f64)| finite(point) && (!decades || (point.0 > 0.0 && point.1 > 0.0));
    let object_of = |line: &Series| {
        let points: Vec<(f64, f64)> = line.points.iter().filter(shown).copied().collect();
        let points = if line.mark == Mark::Line {
            thinned(&points, if line.is_light { FEW_POINTS } else { MOST_POINTS })
        } else {
            points
        };
        let mut value = object(line, &points);
        if let Some(states) = &line.states {
            value.insert("states".to_string(), json!(states));
        }
        Value::Object(value)
    };
    json!({
        "kind": "curves", "title": words.title, "x": words.x, "y": words.y, "decades": decades,
        "series": series.iter().map(object_of).collect::<Vec<Value>>(),
    })
}

/// A surface over a rectangle; marks are drawn on it.
pub fn surface(
    words: &Words<'_>,
    value_words: &str,
    map: &Map,
    value: &mut dyn FnMut(f64, f64) -> Option<f64>,
    series: &[Series],
) -> Value {
    let axis = |range: (f64, f64), title: &str| json!({ "title": title, "at": (0..=CELLS).map(|k| number(along(range, k))).collect::<Vec<_>>() });
    // The script expects one list for each value of the second axis.
    let z: Vec<Vec<Value>> =
        (0..=CELLS).map(|j| (0..=CELLS).map(|i| map.corners[i][j].map_or(Value::Null, number)).collect()).collect();
    let mut object_of = |line: &Series| {
        let points: Vec<(f64, f64)> = line.points.iter().filter(finite).copied().collect();
        let mut object = object(line, &points);
        let on: Vec<Value> = points.iter().map(|(x, y)| value(*x, *y).map_or(Value::Null, number)).collect();
        object.insert("z".to_string(), Value::Array(on));
        Value::Object(object)
    };
    let series: Vec<Value> = series.iter().map(&mut object_of).collect();
    json!({
        "kind": "surface", "title": words.title, "x": axis(map.x, words.x), "y": axis(map.y, words.y), "z": z, "z_title": value_words,
        "series": series,
    })
}

fn object(series: &Series, points: &[(f64, f64)]) -> Object<String, Value> {
    let mut value = Object::new();
    value.insert("name".to_string(), json!(series.name));
    value.insert("colour".to_string(), json!(name_of(series.colour)));
    value.insert("mark".to_string(), json!(mark(series.mark)));
    value.insert("x".to_string(), points.iter().map(|point| number(point.0)).collect());
    value.insert("y".to_string(), points.iter().map(|point| number(point.1)).collect());
    value
}

/// The mark's name for the scripts.
pub fn mark(mark: Mark) -> &'static str {
    match mark {
        Mark::Line => "line",
        Mark::Circle => "circle",
        Mark::Cross => "cross",
    }
}

/// A number with the digits that a plot can show; null where it is not finite.
pub fn number(value: f64) -> Value {
    let short: f64 = format!("{value:.*e}", DIGITS - 1).parse().unwrap_or(value);
    // A whole number is written without a decimal point.
    if short.fract() == 0.0 && short.abs() < 1e15 { json!(short as i64) } else { json!(short) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::BLUE;

    #[test]
    fn numbers_are_short_and_what_is_not_finite_is_null_or_left_out() {
        let texts: Vec<String> = [0.1 + 0.2, 2.0, -0.0, f64::NAN, 1e300].map(|value| number(value).to_string()).to_vec();
        assert_eq!(texts, ["0.3", "2", "0", "null", "1e+300"]);
        let series = [Series::new("a", BLUE, Mark::Line, vec![(1.0, 1.0), (0.0, 1.0), (10.0, f64::INFINITY), (100.0, 50.0)])];
        let made = curves(&Words { title: "t", x: "x", y: "y" }, &series, true);
        assert_eq!(made["series"][0]["x"], json!([1, 100]));
    }

    #[test]
    fn a_map_has_one_row_for_each_value_of_its_second_axis() {
        let mut value = |x: f64, y: f64| (y < 1.0).then_some(x + 10.0 * y);
        let map = Map::new((0.0, 48.0), (0.0, 1.0), &mut value);
        let made = surface(&Words { title: "t", x: "x", y: "y" }, "z", &map, &mut value, &[]);
        assert_eq!(made["z"][0][3], json!(3));
        assert_eq!(made["z"][24][0], json!(5));
        assert_eq!(made["z"][48][0], Value::Null);
    }
}
