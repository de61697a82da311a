//! HTML pages that need no other file.

/// Style of every page, readable on a light and on a dark ground.
const STYLE: &str = "
:root{color-scheme:light dark}
body{font:15px/1.5 sans-serif;max-width:960px;margin:2em auto;padding:0 1em;background:Canvas;color:CanvasText}
h1{font-size:1.6em;margin-bottom:.2em}h2{font-size:1.2em;margin-top:2em}
svg{max-width:100%;height:auto}
.key{font-size:13px;margin:.3em 0}.key span{margin-right:1.4em;white-space:nowrap}.key svg{vertical-align:-1px}
table{border-collapse:collapse;font-size:13px;font-variant-numeric:tabular-nums}
th,td{text-align:right;padding:.15em .6em;border-bottom:1px solid color-mix(in srgb,CanvasText 15%,Canvas)}
th:first-child,td:first-child{text-align:left}th{font-weight:600;vertical-align:bottom}
.sections th,.sections td{text-align:left;vertical-align:top;font-size:15px}
.wide{overflow-x:auto}.small{font-size:13px;opacity:.8}.bad{color:#d0342c;font-weight:bold}
summary{cursor:pointer;margin:.4em 0}
";

/// A whole page around its body.
#[must_use]
pub fn page(title: &str, body: &str) -> String {
    let title = escaped(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\"><title>{title}</title>\n<style>{STYLE}</style></head>\n<body>\n<h1>{title}</h1>\n{body}</body></html>\n"
    )
}

/// Text with the reserved characters of XML replaced.
#[must_use]
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
