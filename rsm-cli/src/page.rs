//! The page around a report: one self-contained HTML file.
//!
//! In: a title and a body of HTML. Out: text. Nothing is fetched from anywhere when it is read.

/// The whole page.
pub fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"generator\" content=\"rsm\">\n<title>{}</title>\n<style>\n\
         body {{ font: 15px/1.5 sans-serif; color: #222; max-width: 1000px; margin: 2em auto; padding: 0 1em; }}\n\
         table {{ border-collapse: collapse; margin: 0.8em 0; }}\n\
         th, td {{ border: 1px solid #ccc; padding: 0.2em 0.7em; text-align: left; font-variant-numeric: tabular-nums; }}\n\
         th {{ background: #f3f3f3; font-weight: 600; }}\n\
         .missed {{ background: #fbe3d6; }}\n\
         .verdict {{ border-left: 6px solid #0072b2; background: #f3f7fa; padding: 0.6em 1em; font-size: 17px; }}\n\
         .verdict.unexplained {{ border-color: #d55e00; background: #fdf4ee; }}\n\
         .bar {{ display: inline-block; height: 0.75em; vertical-align: middle; }}\n\
         td.bars {{ min-width: 220px; white-space: nowrap; }}\n\
         td.number {{ text-align: right; white-space: nowrap; }}\n\
         .note {{ color: #666; font-size: 13px; }}\n\
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

/// A bar of a share of 200 pixels, in a colour of CSS.
pub fn bar(share: f64, colour: &str) -> String {
    format!("<span class=\"bar\" style=\"width:{:.0}px;background:{colour}\"></span>", 200.0 * share.clamp(0.0, 1.0))
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
