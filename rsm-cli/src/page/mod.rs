//! The page around a report: one self-contained HTML file.
//!
//! In: a title and a body of HTML. Out: text. The page loads nothing from other places; its content security policy forbids it. Without scripts, and
//! on paper, the static pictures and the tables remain.

pub mod number;
mod pictures;
pub mod summary;

pub use number::{figure, known, multiple, short, with_unit};
use std::io::Write as _;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD as STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::Value;

const STYLE: &str = include_str!("assets/style.css");

/// Our scripts: theme, table of contents, switches; plots; the interactive surface.
const SCRIPTS: [&str; 3] =
    [include_str!("assets/page.js"), include_str!("assets/plots.js"), include_str!("assets/explorer.js")];

/// Plotly with its 3D plots: the file of the npm package `plotly.js-gl3d-dist-min`, compressed with `gzip -9n`, in base64
/// (docs/decisions/026-pages-with-plotly.md).
const LIBRARY: &str = include_str!("assets/plotly/plotly-gl3d-4.1.1.min.js.gz.b64");

/// The licence must be kept with the library.
const LICENCE: &str = include_str!("assets/plotly/LICENSE");

/// The content security policy: only this page, and pictures of plots that its own script makes.
const POLICY: &str =
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:";

/// The whole page. The library is included only if a figure has numbers for it.
pub fn page(title: &str, body: &str) -> String {
    let library = if body.contains(NUMBERS) {
        format!("<!-- Plotly.js 4.1.1\n{LICENCE}-->\n<script id=\"library\" type=\"text/plain\">\n{LIBRARY}</script>\n")
    } else {
        String::new()
    };
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"generator\" content=\"rsm\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <title>{}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
         <div class=\"top\"><nav aria-label=\"Contents\"></nav><button class=\"theme\" type=\"button\" title=\"Light or dark\">Dark</button></div>\n\
         <main>\n{}</main>\n{library}<script>\n{}</script>\n</body>\n</html>\n",
        escaped(title),
        pictures::smaller(body),
        SCRIPTS.concat()
    )
}

/// Text with the special characters of HTML replaced.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The beginning of the element with the numbers of a figure.
const NUMBERS: &str = "<script type=\"application/json\"";

/// Numbers whose text is longer are compressed. A small figure stays readable, and gzip does not pay for it.
const MOST_READABLE: usize = 4096;

/// The element with the numbers for the scripts. No text in the numbers can end this element.
pub fn numbers(value: &Value) -> String {
    let text = value.to_string().replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026");
    if text.len() > MOST_READABLE
        && let Ok(packed) = packed(text.as_bytes())
    {
        return format!("{NUMBERS} data-packed>{}</script>\n", STANDARD.encode(packed));
    }
    format!("{NUMBERS}>{text}</script>\n")
}

/// Bytes compressed with gzip: the same bytes for the same text, without a time.
fn packed(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// A bar with this share of 200 pixels, in a class of the style sheet: `before` or `after`.
pub fn bar(share: f64, class: &str) -> String {
    format!("<span class=\"bar {class}\" style=\"width:{:.0}px\"></span>", 200.0 * share.clamp(0.0, 1.0))
}

/// Rows of a table without a head: a name and a value, as HTML.
pub fn rows(rows: &[(String, String)]) -> String {
    let each: String = rows.iter().map(|(name, value)| format!("<tr><th>{name}</th><td>{value}</td></tr>\n")).collect();
    if each.is_empty() { each } else { format!("<table>\n{each}</table>\n") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sha2::{Digest as _, Sha256};
    use std::io::Read as _;

    #[test]
    fn the_library_is_the_file_of_its_package() {
        let text = unpacked(LIBRARY);
        let digest: String = Sha256::digest(&text).iter().map(|byte| format!("{byte:02x}")).collect();
        // SHA-256 of package/plotly-gl3d.min.js of plotly.js-gl3d-dist-min 4.1.1.
        assert_eq!(digest, "aab04dcd9c103a92b18723f8c837712fe820f325d0bcd2421e415e8124a75b9f");
        let text = String::from_utf8(text).unwrap();
        assert!(text.starts_with("/**\n* plotly.js (gl3d - minified) v4.1.1\n") && text[..200].contains("MIT license"));
        assert!(LICENCE.starts_with("MIT License") || LICENCE.starts_with("The MIT License"), "{LICENCE}");
    }

    /// The bytes of a text in base64, uncompressed.
    fn unpacked(text: &str) -> Vec<u8> {
        let packed = STANDARD.decode(text.split_ascii_whitespace().collect::<String>()).unwrap();
        let mut bytes = Vec::new();
        flate2::read::GzDecoder::new(packed.as_slice()).read_to_end(&mut bytes).unwrap();
        bytes
    }

    #[test]
    fn many_numbers_are_compressed_and_few_are_not() {
        let many: Value = (0..5000).map(|k| f64::from(k) / 7.0).collect();
        let made = numbers(&many);
        let begin = format!("{NUMBERS} data-packed>");
        let inside = made.strip_prefix(&begin).unwrap().strip_suffix("</script>\n").unwrap();
        assert!(2 * inside.len() < many.to_string().len() + 1000, "{}", inside.len());
        assert_eq!(serde_json::from_slice::<Value>(&unpacked(inside)).unwrap(), many);
        assert!(numbers(&serde_json::json!([1, 2])).starts_with(&format!("{NUMBERS}>[1,2]")));
    }

    #[test]
    fn no_text_ends_the_element_that_holds_it() {
        let evil = "</script><script>alert(1)</script><!--&\u{2028}";
        let made = numbers(&serde_json::json!({ evil: evil }));
        let inside = made.strip_prefix(NUMBERS).unwrap().strip_prefix('>').unwrap().strip_suffix("</script>\n").unwrap();
        assert!(!inside.contains('<') && !inside.contains('&'));
        let read: Value = serde_json::from_str(inside).unwrap();
        assert_eq!(read[evil], evil);
        assert!(!escaped(evil).contains('<'));
    }

    #[test]
    fn a_page_names_no_place_to_fetch_from() {
        let page = page("t", &format!("<p>x</p>{}", numbers(&Value::Null)));
        assert!(!page.contains("src=") && !page.contains("<link") && !page.contains("@import") && !page.contains("url("));
        assert!(page.contains("default-src 'none'"));
    }
}
