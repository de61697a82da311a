//! The result as text and as a page.

use super::result::{Figure, Series, Thesis};
use crate::machine::Machine;
use crate::report::chart::{Ground, grid, key};
use crate::report::html::{self, escaped};
use crate::report::table::Table;
use crate::report::units::{digits, grouped};
use std::fmt::Write as _;

/// A whole number with its thousands, any other with three digits.
fn number(value: f64) -> String {
    if value.fract() == 0.0 && value >= 0.0 {
        grouped(value as u64)
    } else {
        digits(value)
    }
}

fn with_unit(value: f64, unit: &str) -> String {
    if unit.is_empty() {
        number(value)
    } else {
        format!("{} {unit}", number(value))
    }
}

fn published(series: &Series) -> String {
    let numbers: Vec<String> = series.published.iter().copied().map(number).collect();
    numbers.join(" to ")
}

fn table(figure: &Figure) -> Table {
    let mut table = Table::new(1, "what | ours | thesis");
    for series in &figure.series {
        table.row([
            series.name.clone(),
            with_unit(series.ours, series.unit),
            published(series),
        ]);
    }
    table
}

/// "Figure 4.7", "Table 4.1", "Section 5.8".
fn heading(figure: &Figure) -> String {
    let number = figure.figure;
    match number.strip_prefix("table") {
        Some(of_table) => format!("Table {of_table}"),
        None if super::IS_FIGURE.contains(&number) => format!("Figure {number}"),
        None => format!("Section {number}"),
    }
}

/// The tables of the terminal.
#[must_use]
pub fn words(found: &Thesis) -> String {
    let mut text = String::new();
    for figure in &found.figures {
        let _ = writeln!(
            text,
            "\n{}: {}\n{}{}",
            heading(figure),
            figure.title,
            table(figure),
            figure.says
        );
    }
    for failed in &found.failed {
        let _ = writeln!(text, "\nfailed: {failed}");
    }
    text
}

/// The page.
#[must_use]
pub fn page(found: &Thesis, machine: &Machine) -> String {
    let mut html = format!(
        "<p>The figures of the performance studies of the thesis, measured on {}: ours beside the number that its text \
         publishes, where it does. Its machine was a Pentium 4 of 2.8 GHz, so ratios are compared and not times.</p>\n",
        escaped(&found.models.join(", "))
    );
    for figure in &found.figures {
        let _ = writeln!(
            html,
            "<h2>{}: {}</h2>\n<p>{}</p>",
            heading(figure),
            escaped(figure.title),
            escaped(&figure.says)
        );
        if !figure.charts.is_empty() {
            html.push_str(&key("", &figure.names));
            let columns = figure.charts.len().min(2);
            html.push_str(&grid(&figure.charts, columns, 290.0, Ground::Page));
        }
        for quote in &figure.quotes {
            let _ = writeln!(
                html,
                "<p class=\"small\">The thesis ({}, line {} of its text): “{}”</p>",
                quote.section,
                quote.line,
                escaped(quote.text)
            );
        }
        let _ = writeln!(
            html,
            "<details><summary>numbers</summary>{}</details>",
            table(figure).html()
        );
    }
    for failed in &found.failed {
        let _ = writeln!(html, "<p class=\"bad\">Failed: {}</p>", escaped(failed));
    }
    let _ = writeln!(
        html,
        "<p class=\"small\">Measured on {}, kernel {} ({}), seed {}. Times are processor time of one thread without that \
         of other processes. The same numbers are in thesis.json beside this page.</p>",
        escaped(&machine.processor),
        escaped(&machine.kernel),
        escaped(&machine.preemption),
        found.seed
    );
    html::page("The thesis by number", &html)
}
