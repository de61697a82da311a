//! Elements of an SVG as text.

use crate::report::html::escaped;
use std::fmt::Write as _;

/// Ground and text colour of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ground {
    /// None: the picture takes both from the page around it.
    Page,
    /// White with dark text, for a file of its own.
    Paper,
}

/// The start of a picture of a size in pixels; `</svg>` ends it.
pub fn open(ground: Ground, width: f64, height: f64) -> String {
    let paper = match ground {
        Ground::Page => "",
        Ground::Paper => "<rect width=\"100%\" height=\"100%\" fill=\"#fff\" stroke=\"none\"/>\n",
    };
    let color = match ground {
        Ground::Page => "",
        Ground::Paper => " color=\"#222\"",
    };
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\"{color} font-family=\"sans-serif\" font-size=\"11\" fill=\"currentColor\" role=\"img\">\n{paper}"
    )
}

/// Text at a point, with more attributes; `anchor` is `start`, `middle` or `end`.
pub fn words(svg: &mut String, (x, y): (f64, f64), anchor: &str, more: &str, text: &str) {
    let text = escaped(text);
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\"{more}>{text}</text>"
    );
}

/// The heading of a chart.
pub fn heading(svg: &mut String, at: (f64, f64), text: &str) {
    words(
        svg,
        at,
        "start",
        " font-weight=\"bold\" font-size=\"12\"",
        text,
    );
}

/// A path in the colour of the text with more attributes.
pub fn path(svg: &mut String, data: &str, more: &str) {
    let _ = writeln!(svg, "<path d=\"{data}\" stroke=\"currentColor\" {more}/>");
}
