//! Papers that comments cite, as "Ruspini 1997" or "Johnson & Willemsen 2003", and the keys of
//! `shared/REFERENCES.md`.

use std::collections::BTreeSet;

/// The comments of a source file as one text, so that a citation may be wrapped.
fn comments(source: &str) -> String {
    let lines = source.lines().map(str::trim_start);
    let texts = lines.map(|line| match line.strip_prefix("//") {
        Some(text) => text.trim_start_matches(['/', '!']).trim(),
        None => "|",
    });
    texts.collect::<Vec<_>>().join(" ")
}

/// The year that a word is, whatever stands around it.
fn year_of(word: &str) -> Option<&str> {
    let year = word.trim_matches(|c: char| !c.is_alphanumeric());
    let is_year = year.len() == 4 && (year.starts_with("19") || year.starts_with("20"));
    (is_year && year.bytes().all(|byte| byte.is_ascii_digit())).then_some(year)
}

/// A name without what stands around it.
fn name_of(word: &str) -> Option<&str> {
    let name = word.trim_matches(|c: char| !c.is_alphanumeric());
    let begins = name.chars().next().is_some_and(char::is_uppercase);
    let is_name = begins && name.chars().all(|c| c.is_alphabetic() || c == '-');
    is_name.then_some(name)
}

/// The papers that a source file cites: first author and year.
pub fn of_source(source: &str) -> BTreeSet<String> {
    let text = comments(source);
    let words: Vec<&str> = text.split_whitespace().collect();
    let mut cited = BTreeSet::new();
    for (k, year) in words
        .iter()
        .enumerate()
        .filter_map(|(k, word)| Some((k, year_of(word)?)))
    {
        // One author, or two that "&" or "and" joins.
        let Some(last) = k.checked_sub(1).and_then(|at| name_of(words[at])) else {
            continue;
        };
        let joined = k >= 3 && matches!(words[k - 2], "&" | "and");
        let first = joined.then(|| name_of(words[k - 3])).flatten();
        cited.insert(format!("{} {year}", first.unwrap_or(last)));
    }
    cited
}

/// The keys of a page of tables: the first cell of each row.
pub fn keys(page: &str) -> BTreeSet<&str> {
    let rows = page.lines().filter_map(|line| line.strip_prefix("| "));
    rows.filter_map(|row| row.split(" |").next()).collect()
}

#[test]
fn citations_are_found_where_lines_wrap() {
    let source = "// After Zilles & Salisbury 1995 and\n// Ruspini 1997; in 2003 (Johnson and\n\
                  // Willemsen 2003).\nlet year = 1999;\n// 2001";
    let found = of_source(source);
    let expected = ["Johnson 2003", "Ruspini 1997", "Zilles 1995"];
    assert!(found.iter().eq(&expected), "{found:?}");
}
