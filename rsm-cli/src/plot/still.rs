//! Static plots as SVG text: for print, for pages without a script, and for documents.
//!
//! In: series, with the labels of the axes. Out: SVG. The same numbers give the same text.

use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::{
    Cartesian2d, Circle, Cross, DrawingArea, IntoDrawingArea, PathElement, Rectangle, SVGBackend, ShapeStyle,
};
use plotters::style::{BLACK, Color, IntoFont, RGBColor, WHITE};

use super::{CELLS, Map, Mark, Series, Words, finite, thinned};
use crate::outcome::Refusal;

/// Size of a plot in pixels.
const PLOT: (u32, u32) = (480, 340);

/// The largest number of points of a line; a plot of this width cannot resolve more.
const MOST_POINTS: usize = 1200;

/// Level lines between the least and the greatest value.
const LEVELS: usize = 9;

type Backend<'a> = SVGBackend<'a>;
type Chart<'a, 'b> = ChartContext<'a, Backend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

fn failed(error: impl std::fmt::Display) -> Refusal {
    Refusal::new(format!("a plot cannot be drawn: {error}"))
}

/// Curves and marks over two axes. Points that are not finite are left out.
pub fn curves(words: &Words<'_>, series: &[Series]) -> Result<String, Refusal> {
    let shown = |axis: fn(&(f64, f64)) -> f64| series.iter().flat_map(move |each| each.points.iter().filter(finite).map(axis));
    let (x, y) = (span(shown(|point| point.0), 0.02), span(shown(|point| point.1), 0.06));
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, PLOT).into_drawing_area();
        area.fill(&WHITE).map_err(failed)?;
        let mut chart = axes(&area, words, x, y)?;
        draw(&mut chart, series)?;
        area.present().map_err(failed)?;
    }
    Ok(svg)
}

/// Curves over two logarithmic axes. Points that are not above 0 are left out.
pub fn decades(words: &Words<'_>, series: &[Series]) -> Result<String, Refusal> {
    let logarithms: Vec<Series> = series
        .iter()
        .map(|each| {
            let above = each.points.iter().filter(|point| point.0 > 0.0 && point.1 > 0.0 && finite(point));
            Series { points: above.map(|point| (point.0.log10(), point.1.log10())).collect(), ..each.clone() }
        })
        .collect();
    let shown = |axis: fn(&(f64, f64)) -> f64| logarithms.iter().flat_map(move |each| each.points.iter().map(axis));
    let (x, y) = (span(shown(|point| point.0), 0.02), span(shown(|point| point.1), 0.06));
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, PLOT).into_drawing_area();
        area.fill(&WHITE).map_err(failed)?;
        let mut chart = axes_with(&area, words, x, y, power_of_ten)?;
        draw(&mut chart, &logarithms)?;
        area.present().map_err(failed)?;
    }
    Ok(svg)
}

/// A surface over a rectangle of the plane, with marks on top.
pub fn map(words: &Words<'_>, value_words: &str, map: &Map, series: &[Series]) -> Result<String, Refusal> {
    let (x, y, corners) = (map.x, map.y, &map.corners);
    let along = super::along;
    let (low, high) = span(corners.iter().flatten().filter_map(|value| *value), 0.0);
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, PLOT).into_drawing_area();
        area.fill(&WHITE).map_err(failed)?;
        let (left, right) = area.split_horizontally(PLOT.0 - 80);
        let mut chart = axes(&left, words, x, y)?;
        for i in 0..CELLS {
            for j in 0..CELLS {
                let around = [corners[i][j], corners[i + 1][j], corners[i + 1][j + 1], corners[i][j + 1]];
                let Some(mean) = mean(&around) else { continue };
                let corner = [(along(x, i), along(y, j)), (along(x, i + 1), along(y, j + 1))];
                let colour = colour((mean - low) / (high - low));
                chart.draw_series([Rectangle::new(corner, colour.filled())]).map_err(failed)?;
            }
        }
        for level in (1..=LEVELS).map(|k| low + (high - low) * k as f64 / (LEVELS + 1) as f64) {
            for i in 0..CELLS {
                for j in 0..CELLS {
                    let cell = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                        .map(|(i, j)| corners[i][j].map(|value| (along(x, i), along(y, j), value)));
                    let crossings = crossings(&cell, level);
                    let lines = crossings.chunks_exact(2).map(|pair| PathElement::new(pair.to_vec(), BLACK.mix(0.35)));
                    chart.draw_series(lines).map_err(failed)?;
                }
            }
        }
        draw(&mut chart, series)?;
        scale(&right, value_words, low, high)?;
        area.present().map_err(failed)?;
    }
    Ok(svg)
}

fn axes<'a, 'b>(
    area: &'a DrawingArea<Backend<'b>, plotters::coord::Shift>,
    words: &Words<'_>,
    x: (f64, f64),
    y: (f64, f64),
) -> Result<Chart<'a, 'b>, Refusal> {
    axes_with(area, words, x, y, label)
}

/// Axes whose tick labels are computed from the value and the span.
fn axes_with<'a, 'b>(
    area: &'a DrawingArea<Backend<'b>, plotters::coord::Shift>,
    words: &Words<'_>,
    x: (f64, f64),
    y: (f64, f64),
    label: fn(f64, (f64, f64)) -> String,
) -> Result<Chart<'a, 'b>, Refusal> {
    let mut chart = ChartBuilder::on(area)
        .caption(words.title, ("sans-serif", 15).into_font())
        .margin(8)
        .x_label_area_size(38)
        .y_label_area_size(56)
        .build_cartesian_2d(x.0..x.1, y.0..y.1)
        .map_err(failed)?;
    let (label_x, label_y) = (|value: &f64| label(*value, x), |value: &f64| label(*value, y));
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .bold_line_style(BLACK.mix(0.12))
        .label_style(("sans-serif", 12))
        .axis_desc_style(("sans-serif", 13))
        .x_labels(6)
        .y_labels(6)
        .x_desc(words.x)
        .y_desc(words.y)
        .x_label_formatter(&label_x)
        .y_label_formatter(&label_y)
        .draw()
        .map_err(failed)?;
    Ok(chart)
}

fn draw(chart: &mut Chart<'_, '_>, series: &[Series]) -> Result<(), Refusal> {
    for each in series {
        let points: Vec<(f64, f64)> = each.points.iter().copied().filter(|point| finite(&point)).collect();
        match each.mark {
            Mark::Line => {
                let style: ShapeStyle = each.colour.stroke_width(2);
                chart.draw_series([PathElement::new(thinned(&points, MOST_POINTS), style)]).map_err(failed)?;
            }
            Mark::Circle => {
                let circles = points.iter().map(|point| Circle::new(*point, 3, each.colour.filled()));
                chart.draw_series(circles).map_err(failed)?;
            }
            Mark::Cross => {
                let crosses = points.iter().map(|point| Cross::new(*point, 4, each.colour.stroke_width(2)));
                chart.draw_series(crosses).map_err(failed)?;
            }
        }
    }
    Ok(())
}

/// The colour scale: which colour belongs to which value.
fn scale(area: &DrawingArea<Backend<'_>, plotters::coord::Shift>, words: &str, low: f64, high: f64) -> Result<(), Refusal> {
    let mut chart = ChartBuilder::on(area)
        .caption(words, ("sans-serif", 13).into_font())
        .margin(8)
        .x_label_area_size(38)
        .y_label_area_size(40)
        .build_cartesian_2d(0.0..1.0, low..high)
        .map_err(failed)?;
    for k in 0..CELLS {
        let at = |k: usize| low + (high - low) * k as f64 / CELLS as f64;
        let middle = (k as f64 + 0.5) / CELLS as f64;
        let bar = Rectangle::new([(0.0, at(k)), (1.0, at(k + 1))], colour(middle).filled());
        chart.draw_series([bar]).map_err(failed)?;
    }
    let names = |value: &f64| label(*value, (low, high));
    let mut mesh = chart.configure_mesh();
    // By default the sizes of text and ticks are a share of the drawing, and this drawing is narrow.
    mesh.disable_mesh()
        .disable_x_axis()
        .y_labels(6)
        .y_label_formatter(&names)
        .label_style(("sans-serif", 12))
        .set_all_tick_mark_size(4);
    mesh.draw().map_err(failed)
}

/// The smallest and the largest value, with a margin as a share of their distance. The span is never empty.
fn span(values: impl Iterator<Item = f64>, margin: f64) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    if low >= high || !(high - low).is_finite() {
        return if low.is_finite() { (low - 1.0, low + 1.0) } else { (0.0, 1.0) };
    }
    (low - margin * (high - low), high + margin * (high - low))
}

/// The label of a tick, with the number of decimals that the span requires.
fn label(value: f64, (low, high): (f64, f64)) -> String {
    let decimals = (2.0 - (high - low).abs().log10()).ceil().clamp(0.0, 9.0) as usize;
    let text = format!("{value:.decimals$}");
    // With more than four decimals a number is wider than its place beside the axis.
    if decimals > 4 {
        let shown: f64 = text.parse().unwrap_or(value);
        return if shown == 0.0 { "0".to_string() } else { format!("{shown:e}") };
    }
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_string() } else { text.to_string() }
}

/// The label of a tick on a logarithmic axis: whole decades. If the span has fewer than two of them, the ticks between them also get labels.
fn power_of_ten(value: f64, (low, high): (f64, f64)) -> String {
    let is_whole = (value - value.round()).abs() < 1e-6;
    if !is_whole && high - low >= 2.0 {
        return String::new();
    }
    let number = 10.0_f64.powf(value);
    if !(1e-3..1e5).contains(&number) {
        return format!("{number:.0e}");
    }
    let decimals = (1.0 - value.floor()).clamp(0.0, 4.0) as usize;
    format!("{number:.*}", if is_whole { decimals.saturating_sub(1) } else { decimals })
}

fn mean(values: &[Option<f64>]) -> Option<f64> {
    let known: Option<Vec<f64>> = values.iter().copied().collect();
    known.map(|known| known.iter().sum::<f64>() / known.len() as f64)
}

/// The points where a level line crosses the sides of a cell, in the order of the sides: two points, or four at a saddle.
fn crossings(cell: &[Option<(f64, f64, f64)>; 4], level: f64) -> Vec<(f64, f64)> {
    let mut found = Vec::new();
    for k in 0..4 {
        let (Some(a), Some(b)) = (cell[k], cell[(k + 1) % 4]) else { return Vec::new() };
        if (a.2 < level) != (b.2 < level) {
            let share = (level - a.2) / (b.2 - a.2);
            found.push((a.0 + share * (b.0 - a.0), a.1 + share * (b.1 - a.1)));
        }
    }
    found
}

/// From dark blue through green to yellow. The lightness always increases, so a print in grey keeps the order of values.
fn colour(share: f64) -> RGBColor {
    const ANCHORS: [[f64; 3]; 5] =
        [[58.0, 50.0, 120.0], [48.0, 104.0, 150.0], [52.0, 152.0, 140.0], [130.0, 200.0, 100.0], [245.0, 230.0, 90.0]];
    let position = share.clamp(0.0, 1.0) * 4.0;
    let below = (position.floor() as usize).min(3);
    let part = position - below as f64;
    let [red, green, blue] =
        [0, 1, 2].map(|k| (ANCHORS[below][k] + part * (ANCHORS[below + 1][k] - ANCHORS[below][k])).round() as u8);
    RGBColor(red, green, blue)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::BLUE;

    #[test]
    fn a_level_crosses_a_slope_once_and_a_saddle_twice() {
        let cell = |values: [f64; 4]| {
            [(0.0, 0.0, values[0]), (1.0, 0.0, values[1]), (1.0, 1.0, values[2]), (0.0, 1.0, values[3])].map(Some)
        };
        assert_eq!(crossings(&cell([0.0, 4.0, 4.0, 0.0]), 1.0), [(0.25, 0.0), (0.25, 1.0)]);
        assert_eq!(crossings(&cell([0.0, 2.0, 0.0, 2.0]), 1.0).len(), 4);
        assert!(crossings(&cell([0.0, 1.0, 1.0, 0.0]), 5.0).is_empty());
    }

    #[test]
    fn ticks_have_the_decimals_of_their_span() {
        assert_eq!(label(0.25, (0.0, 1.0)), "0.25");
        assert_eq!(label(1500.0, (0.0, 7500.0)), "1500");
        assert_eq!(label(-0.0, (-1.0, 1.0)), "0");
        assert_eq!([-0.00005, 0.0, 0.0001].map(|value| label(value, (-1e-4, 1.2e-4))), ["-5e-5", "0", "1e-4"]);
    }

    #[test]
    fn decades_are_named_and_what_is_not_above_zero_is_left_out() {
        assert_eq!(
            [-2.0, -1.0, 0.0, 2.0, 6.0].map(|value| power_of_ten(value, (-3.0, 7.0))),
            ["0.01", "0.1", "1", "100", "1e6"]
        );
        assert_eq!(power_of_ten(0.5, (-3.0, 7.0)), "");
        assert_eq!(power_of_ten(0.5, (0.0, 1.0)), "3.2");
        let series = [Series::new("a", BLUE, Mark::Line, vec![(1.0, 1.0), (0.0, 1.0), (10.0, -1.0), (100.0, 50.0)])];
        let text = decades(&Words { title: "t", x: "x", y: "y" }, &series).unwrap();
        assert!(text.contains("<svg") && !text.contains("NaN") && !text.contains("inf"));
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        let series = [Series::new("a", BLUE, Mark::Line, vec![(0.0, 0.0), (f64::NAN, 1.0), (1.0, f64::INFINITY), (2.0, 1.0)])];
        let text = curves(&Words { title: "t", x: "x", y: "y" }, &series).unwrap();
        assert!(text.contains("<svg") && !text.contains("NaN") && !text.contains("inf"));
    }
}
