//! Everything that a command shows: numbers in words, tables, pictures, pages and files.
//!
//! | module | holds |
//! |---|---|
//! | [`units`] | lengths, bytes, shares and counts as a person reads them |
//! | [`quantile`] | the quantiles of measured numbers |
//! | [`table`] | columns of text for the terminal and HTML tables of the same rows |
//! | [`chart`] | curves, bands and stacked bars as SVG |
//! | [`html`] | the frame of an HTML page, and escaping |
//! | [`output`] | standard output, JSON, files and the status line |

pub mod chart;
pub mod html;
pub mod output;
pub mod quantile;
pub mod table;
pub mod units;
