//! The page around a report: one self-contained HTML file.
//!
//! In: a title and a body of HTML. Out: text. Nothing is fetched from anywhere when it is read.

/// The whole page.
pub fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{}</title>\n<style>\n\
         body {{ font: 15px/1.5 sans-serif; color: #222; max-width: 1000px; margin: 2em auto; padding: 0 1em; }}\n\
         table {{ border-collapse: collapse; margin: 0.8em 0; }}\n\
         th, td {{ border: 1px solid #ccc; padding: 0.2em 0.7em; text-align: left; font-variant-numeric: tabular-nums; }}\n\
         th {{ background: #f3f3f3; font-weight: 600; }}\n\
         .missed {{ background: #fbe3d6; }}\n\
         figure {{ margin: 0; max-width: 480px; }}\n\
         figcaption {{ font-size: 13px; text-align: center; }}\n\
         pre {{ white-space: pre-wrap; }}\n\
         .plots {{ display: flex; flex-wrap: wrap; gap: 1em; }}\n</style>\n</head>\n<body>\n{body}\
         </body>\n</html>\n",
        escaped(title)
    )
}

/// Text as HTML shows it.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A number with five significant digits.
pub fn figure(value: Option<f64>) -> String {
    match value {
        None => "none".to_string(),
        Some(value) if value == 0.0 || (1e-3..1e5).contains(&value.abs()) => {
            let before = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
            format!("{value:.*}", (4 - before).max(0) as usize)
        }
        Some(value) => format!("{value:.4e}"),
    }
}
