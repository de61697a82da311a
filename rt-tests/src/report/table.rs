//! Tables: aligned columns for the terminal, and the same rows as HTML.

use super::html::escaped;
use std::fmt::{Display, Formatter, Write as _};

/// Rows of cells under headings; the first columns are text (left), the others numbers (right).
#[derive(Debug, Clone)]
pub struct Table {
    /// Headings; a line break stacks words.
    heads: Vec<String>,
    /// Columns of text.
    texts: usize,
    /// Characters of each column.
    widths: Vec<usize>,
    /// Between two columns.
    gap: &'static str,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table whose first `texts` columns are text; headings stand as in `"model | faces"`.
    #[must_use]
    pub fn new(texts: usize, heads: &str) -> Self {
        let heads: Vec<String> = heads.split(" | ").map(String::from).collect();
        let width = |head: &String| head.lines().map(count).max().unwrap_or(0);
        Self {
            widths: heads.iter().map(width).collect(),
            heads,
            texts,
            gap: "  ",
            rows: Vec::new(),
        }
    }

    /// Makes columns at least so wide, for rows that are printed before the next are known.
    #[must_use]
    pub fn at_least(mut self, widths: &[usize]) -> Self {
        for (width, least) in self.widths.iter_mut().zip(widths) {
            *width = (*width).max(*least);
        }
        self
    }

    /// One blank between the columns in place of two, for many columns.
    #[must_use]
    pub fn compact(mut self) -> Self {
        self.gap = " ";
        self
    }

    /// Adds a row.
    pub fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        let cells: Vec<String> = cells.into_iter().collect();
        for (width, cell) in self.widths.iter_mut().zip(&cells) {
            *width = (*width).max(count(cell));
        }
        self.rows.push(cells);
    }

    /// The headings as lines of text, the lowest words at the bottom.
    #[must_use]
    pub fn head(&self) -> String {
        let depth = self.heads.iter().map(|head| head.lines().count()).max();
        let depth = depth.unwrap_or(0);
        (0..depth)
            .map(|line| {
                let words = self.heads.iter().map(|head| {
                    let above = depth - head.lines().count();
                    let word = line.checked_sub(above).and_then(|k| head.lines().nth(k));
                    word.unwrap_or("").to_string()
                });
                self.line(words)
            })
            .collect()
    }

    /// A row as a line of text that is not kept.
    #[must_use]
    pub fn line(&self, cells: impl IntoIterator<Item = String>) -> String {
        let mut text = String::new();
        for (column, (cell, width)) in cells.into_iter().zip(&self.widths).enumerate() {
            let gap = if column == 0 { "" } else { self.gap };
            let _ = if column < self.texts {
                write!(text, "{gap}{cell:<width$}")
            } else {
                write!(text, "{gap}{cell:>width$}")
            };
        }
        text.truncate(text.trim_end().len());
        text.push('\n');
        text
    }

    /// The table as HTML.
    #[must_use]
    pub fn html(&self) -> String {
        let mut html = String::from("<div class=\"wide\"><table><tr>");
        for head in &self.heads {
            let _ = write!(html, "<th>{}", escaped(&head.replace('\n', " ")));
        }
        html.push_str("</tr>\n");
        for row in &self.rows {
            html.push_str("<tr>");
            for cell in row {
                let _ = write!(html, "<td>{}", escaped(cell));
            }
            html.push_str("</tr>\n");
        }
        html.push_str("</table></div>\n");
        html
    }
}

impl Display for Table {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.head())?;
        for row in &self.rows {
            f.write_str(&self.line(row.iter().cloned()))?;
        }
        Ok(())
    }
}

fn count(text: &str) -> usize {
    text.chars().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let mut table = Table::new(1, "model | time\np50 | p99").at_least(&[0, 0, 5]);
        table.row(["a sphere", "1", "23"].map(String::from));
        let expected = "          time\nmodel      p50    p99\na sphere     1     23\n";
        assert_eq!(table.to_string(), expected);
        assert!(
            table
                .html()
                .contains("<th>time p50<th>p99</tr>\n<tr><td>a sphere<td>1")
        );
    }
}
