//! Smaller still pictures: the same drawing in fewer characters.
//!
//! In: the body of a page, whose pictures have one element of SVG a line. Out: the same body. Attributes with their default value are removed, and
//! neighbouring cells, marks and lines of one colour become one path. The order of drawing stays.

use std::fmt::Write as _;

/// Elements of which default values are removed.
const SHAPES: [&str; 5] = ["<rect ", "<circle ", "<line ", "<polyline ", "<polygon "];

/// The body with smaller pictures.
pub fn smaller(body: &str) -> String {
    let mut text = String::with_capacity(body.len());
    let mut path = Path::default();
    for line in body.split_inclusive('\n') {
        let Some(shape) = SHAPES.iter().find(|it| line.starts_with(**it)) else {
            path.end(&mut text);
            text.push_str(line);
            continue;
        };
        let short = without_defaults(line);
        match part(shape, &short) {
            Some(part) => path.add(part, &mut text),
            None => {
                path.end(&mut text);
                text.push_str(&short);
            }
        }
    }
    path.end(&mut text);
    text
}

/// A shape without attributes that have their default value. A width of a line that is not drawn says nothing.
fn without_defaults(line: &str) -> String {
    let mut short = line.replace(" opacity=\"1\"", "");
    if short.contains(" stroke=\"none\"") {
        short = short.replace(" stroke=\"none\"", "").replace(" stroke-width=\"1\"", "");
    }
    short.replace(" stroke-width=\"1\"", "")
}

/// A part of a path: attributes of the path, and what it draws.
struct Part {
    style: String,
    drawn: String,
}

/// A filled rectangle, a disc or a line as a part of a path; `None` for another shape, or one with further attributes.
fn part(shape: &str, line: &str) -> Option<Part> {
    let mut left = line.trim_end().strip_prefix(shape)?.strip_suffix("/>")?;
    let mut next = |name: &str| -> Option<&str> {
        let (value, rest) = left.trim_start().strip_prefix(name)?.strip_prefix("=\"")?.split_once('"')?;
        left = rest;
        Some(value)
    };
    let found = match shape {
        "<rect " => {
            let [x, y, width, height] = [next("x")?, next("y")?, next("width")?, next("height")?];
            Part { style: format!("fill=\"{}\"", next("fill")?), drawn: format!("M{x} {y}h{width}v{height}h-{width}z") }
        }
        "<circle " => {
            let [x, y, radius] = [next("cx")?, next("cy")?, next("r")?];
            let width = 2.0 * radius.parse::<f64>().ok()?;
            // A line without length that has round ends is a disc.
            let style = format!("stroke=\"{}\" stroke-width=\"{width}\" stroke-linecap=\"round\"", next("fill")?);
            Part { style, drawn: format!("M{x} {y}h0") }
        }
        "<line " => {
            let stroke = next("stroke")?;
            let [x, y, to_x, to_y] = [next("x1")?, next("y1")?, next("x2")?, next("y2")?];
            Part { style: format!("stroke=\"{stroke}\""), drawn: format!("M{x} {y}L{to_x} {to_y}") }
        }
        "<polyline " => {
            let (fill, stroke) = (next("fill")?, next("stroke")?);
            let points = next("points")?.trim();
            let is_line = fill == "none" && !points.is_empty();
            is_line.then(|| Part { style: format!("fill=\"none\" stroke=\"{stroke}\""), drawn: format!("M{points}") })?
        }
        _ => return None,
    };
    left.trim().is_empty().then_some(found)
}

/// A path that grows by parts of one style.
#[derive(Default)]
struct Path {
    style: String,
    drawn: String,
}

impl Path {
    fn add(&mut self, part: Part, text: &mut String) {
        if part.style != self.style {
            self.end(text);
            self.style = part.style;
        }
        self.drawn.push_str(&part.drawn);
    }

    /// Writes the path, if it has any part.
    fn end(&mut self, text: &mut String) {
        if !self.drawn.is_empty() {
            let _ = writeln!(text, "<path {} d=\"{}\"/>", self.style, self.drawn);
        }
        *self = Path::default();
    }
}

#[cfg(test)]
mod tests {
    use super::smaller;

    #[test]
    fn neighbours_of_one_colour_are_one_path_in_their_order() {
        let cell = |x: u32, fill: &str| {
            format!("<rect x=\"{x}\" y=\"5\" width=\"7\" height=\"4\" opacity=\"1\" fill=\"{fill}\" stroke=\"none\"/>\n")
        };
        let mark = "<circle cx=\"3\" cy=\"4\" r=\"3\" opacity=\"1\" fill=\"#AA0000\" stroke=\"none\" stroke-width=\"1\"/>\n";
        let body = ["<svg>\n", &cell(1, "#111111"), &cell(8, "#111111"), &cell(15, "#222222"), mark, mark, "</svg>\n"].concat();
        let expected = "<svg>\n<path fill=\"#111111\" d=\"M1 5h7v4h-7zM8 5h7v4h-7z\"/>\n<path fill=\"#222222\" d=\"M15 5h7v4h-7z\"/>\n\
                        <path stroke=\"#AA0000\" stroke-width=\"6\" stroke-linecap=\"round\" d=\"M3 4h0M3 4h0\"/>\n</svg>\n";
        assert_eq!(smaller(&body), expected);
    }

    #[test]
    fn other_shapes_lose_only_defaults_and_text_stays() {
        let body = "<text opacity=\"1\">\n<b>x</b>\n</text>\n<line opacity=\"1\" stroke=\"#FFFFFF\" stroke-width=\"1\" x1=\"6\" y1=\"2\" x2=\"6\" y2=\"9\"/>\n\
                    <polyline fill=\"none\" opacity=\"1\" stroke=\"#00AA00\" stroke-width=\"1\" points=\"1,2 3,4 \"/>\n\
                    <circle cx=\"3\" cy=\"4\" r=\"3\" opacity=\"0.5\" fill=\"#AA0000\" stroke=\"none\" stroke-width=\"1\"/>\n\
                    <circle cx=\"3\" cy=\"4\" r=\"3\" opacity=\"1\" fill=\"none\" stroke=\"#00AA00\" stroke-width=\"2\"/>\n";
        let expected = "<text opacity=\"1\">\n<b>x</b>\n</text>\n<path stroke=\"#FFFFFF\" d=\"M6 2L6 9\"/>\n\
                        <path fill=\"none\" stroke=\"#00AA00\" d=\"M1,2 3,4\"/>\n\
                        <circle cx=\"3\" cy=\"4\" r=\"3\" opacity=\"0.5\" fill=\"#AA0000\"/>\n\
                        <circle cx=\"3\" cy=\"4\" r=\"3\" fill=\"none\" stroke=\"#00AA00\" stroke-width=\"2\"/>\n";
        assert_eq!(smaller(body), expected);
    }
}
