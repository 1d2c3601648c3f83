//! Plots of a page: each is a static SVG picture, with the numbers from which the page's script draws an interactive plot (zoom, rotation, values
//! under the pointer).
//!
//! In: numbers, with the words for axes and legend. Out: a `<figure>` of HTML. Independent of the meaning of the data. The same numbers give the same
//! text.

mod live;
pub mod still;

pub use plotters::style::BLACK;
use plotters::style::RGBColor;
use serde_json::{Value, json};

use crate::outcome::Refusal;
use crate::page::{escaped, numbers};

/// Cells of a map along each axis: the level lines are straight in a cell.
pub const CELLS: usize = 48;

/// Colours that readers with a colour vision deficiency can distinguish (Okabe and Ito 2008), in the order of use.
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
/// The second colour.
pub const ORANGE: RGBColor = RGBColor(213, 94, 0);
/// The colour of marks on a map, whose dark end is blue.
pub const PINK: RGBColor = RGBColor(255, 150, 200);
/// The colour of reference curves.
pub const GREY: RGBColor = RGBColor(140, 140, 140);

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    Line,
    Circle,
    Cross,
}

/// A data series.
#[derive(Debug, Clone)]
pub struct Series {
    pub name: String,
    pub colour: RGBColor,
    pub mark: Mark,
    pub points: Vec<(f64, f64)>,
    /// The states of the switch beside the figure in which the series is shown. `None`: always.
    states: Option<Vec<usize>>,
    /// Whether the static picture shows it.
    is_still: bool,
    /// Whether the interactive plot uses fewer points for it.
    is_light: bool,
}

impl Series {
    pub fn new(name: &str, colour: RGBColor, mark: Mark, points: Vec<(f64, f64)>) -> Self {
        Series { name: name.to_string(), colour, mark, points, states: None, is_still: true, is_light: false }
    }

    /// The same series, shown in one state of the switch only.
    pub fn in_state(self, state: usize) -> Self {
        Series { states: Some(vec![state]), ..self }
    }

    /// The same series, shown in the interactive plot only and with fewer points, because there are many such series.
    pub fn only_live(self) -> Self {
        Series { is_still: false, is_light: true, ..self }
    }
}

/// The words around a plot.
#[derive(Debug, Clone, Copy)]
pub struct Words<'a> {
    pub title: &'a str,
    /// Label of the axis with its unit.
    pub x: &'a str,
    /// Label of the axis with its unit.
    pub y: &'a str,
}

/// A surface over a rectangle: its values at the corners of the cells, `None` where it is not shown.
pub struct Map {
    x: (f64, f64),
    y: (f64, f64),
    corners: Vec<Vec<Option<f64>>>,
}

impl Map {
    /// Evaluates a function at every corner of the cells.
    pub fn new(x: (f64, f64), y: (f64, f64), value: &mut dyn FnMut(f64, f64) -> Option<f64>) -> Self {
        let corners = (0..=CELLS).map(|i| (0..=CELLS).map(|j| value(along(x, i), along(y, j))).collect()).collect();
        Map { x, y, corners }
    }
}

fn along(range: (f64, f64), k: usize) -> f64 {
    range.0 + (range.1 - range.0) * k as f64 / CELLS as f64
}

/// Curves and marks over two axes. Points that are not finite are left out.
pub fn curves(words: &Words<'_>, series: &[Series]) -> Result<String, Refusal> {
    switched(None, words, series)
}

/// The same beside a switch. `group` is the name of the switch.
pub fn switched(group: Option<&str>, words: &Words<'_>, series: &[Series]) -> Result<String, Refusal> {
    let still = stills(series);
    Ok(figure(group, &still::curves(words, &still)?, &still, Some(&live::curves(words, series, false)), ""))
}

/// Curves over two logarithmic axes. Points that are not above 0 are left out.
pub fn decades(words: &Words<'_>, series: &[Series]) -> Result<String, Refusal> {
    let still = stills(series);
    Ok(figure(None, &still::decades(words, &still)?, &still, Some(&live::curves(words, series, true)), ""))
}

/// A surface over a rectangle with marks on top. `None` where the surface is not shown.
pub fn map(
    words: &Words<'_>,
    value_words: &str,
    x: (f64, f64),
    y: (f64, f64),
    value: &mut dyn FnMut(f64, f64) -> Option<f64>,
    series: &[Series],
) -> Result<String, Refusal> {
    let map = Map::new(x, y, value);
    let picture = still::map(words, value_words, &map, series)?;
    Ok(figure(None, &picture, series, Some(&live::surface(words, value_words, &map, value, series)), ""))
}

/// A static picture and the numbers of an interactive surface plot.
pub fn explorer(pictures: &str, series: &[Series], spec: &Value) -> String {
    figure(None, pictures, series, Some(spec), "<div class=\"explorer\"></div>\n")
}

/// A button for each cause. It is pressed while the cause is in the shown curves; at the beginning all are. The state of the switch is the set of
/// pressed buttons as bits; the first button is the lowest bit. `told` is the text for each state. Empty without causes.
pub fn switch(group: &str, of: &str, causes: &[String], state_texts: &[String]) -> String {
    if causes.is_empty() {
        return String::new();
    }
    let button = |name: &String| format!("<button type=\"button\" aria-pressed=\"true\">{}</button>\n", escaped(name));
    format!(
        "<div class=\"switch\" role=\"group\" data-group=\"{}\" data-told=\"{}\">{}\n{}<span class=\"told\" aria-live=\"polite\"></span></div>\n",
        escaped(group),
        escaped(&json!(state_texts).to_string()),
        escaped(of),
        causes.iter().map(button).collect::<String>()
    )
}

fn stills(series: &[Series]) -> Vec<Series> {
    series.iter().filter(|it| it.is_still).cloned().collect()
}

fn figure(group: Option<&str>, svg: &str, series: &[Series], numbers_of: Option<&Value>, place: &str) -> String {
    let legend = series.iter().filter(|each| !each.name.is_empty()).map(|each| {
        let sign = match each.mark {
            Mark::Line => "&#9473;",
            Mark::Circle => "&#9679;",
            Mark::Cross => "&#10005;",
        };
        let RGBColor(red, green, blue) = each.colour;
        format!("<span style=\"color:rgb({red},{green},{blue})\">{sign}</span>&nbsp;{}", escaped(&each.name))
    });
    let legend: Vec<String> = legend.collect();
    let group = group.map_or(String::new(), |group| format!(" data-group=\"{}\"", escaped(group)));
    let place = if place.is_empty() { "<div class=\"live\"></div>\n" } else { place };
    let script = numbers_of.map_or(String::new(), numbers);
    format!(
        "<figure{group}>\n{place}<div class=\"still\">\n{svg}\n</div>\n<figcaption>{}</figcaption>\n{script}</figure>\n",
        legend.join(" &nbsp; ")
    )
}

/// The colour's name for the scripts, which use one colour of this name on light and one on dark paper.
fn name_of(colour: RGBColor) -> &'static str {
    match colour {
        BLUE => "blue",
        ORANGE => "orange",
        PINK => "pink",
        GREY => "grey",
        _ => "black",
    }
}

/// Rows of data that an interactive surface plot shows.
pub fn set(name: &str, colour: RGBColor, mark: Mark, rows: &[Vec<f64>]) -> Value {
    let rows: Vec<Vec<Value>> = rows.iter().map(|row| row.iter().map(|value| live::number(*value)).collect()).collect();
    json!({ "name": name, "colour": name_of(colour), "mark": live::mark(mark), "rows": rows })
}

fn finite(point: &&(f64, f64)) -> bool {
    point.0.is_finite() && point.1.is_finite()
}

/// Reduces a curve of many points to the extremes of equal pieces, so that peaks remain.
fn thinned(points: &[(f64, f64)], most: usize) -> Vec<(f64, f64)> {
    if points.len() <= most {
        return points.to_vec();
    }
    let piece = points.len().div_ceil(most / 2);
    let mut kept = Vec::with_capacity(most);
    for chunk in points.chunks(piece) {
        let by = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (Some(low), Some(high)) = (chunk.iter().min_by(by), chunk.iter().max_by(by)) else { continue };
        let (first, second) = if low.0 <= high.0 { (low, high) } else { (high, low) };
        kept.push(*first);
        kept.push(*second);
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thinned_curve_keeps_its_peak() {
        let mut points: Vec<(f64, f64)> = (0..100_000).map(|k| (f64::from(k), 0.0)).collect();
        points[54_321].1 = 7.0;
        let thin = thinned(&points, 1200);
        assert!(thin.len() <= 1202 && thin.contains(&(54_321.0, 7.0)));
        assert!(thin.windows(2).all(|pair| pair[0].0 <= pair[1].0));
    }

    #[test]
    fn a_still_picture_lacks_what_is_only_live_and_names_are_escaped() {
        let evil = "</script><b>";
        let series = [
            Series::new(evil, BLUE, Mark::Line, vec![(0.0, 1.0), (1.0, 2.0)]),
            Series::new("hidden", ORANGE, Mark::Line, vec![(0.0, 5.0)]).in_state(1).only_live(),
        ];
        let words = Words { title: evil, x: evil, y: evil };
        let text = switched(Some(evil), &words, &series).unwrap();
        assert!(!text.contains(evil) && !text.contains("<b>"), "{text}");
        assert_eq!(text.matches("hidden").count(), 1);
        assert!(text.contains("\"states\":[1]"));
    }
}
