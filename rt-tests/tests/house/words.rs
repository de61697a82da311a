//! The private words: identifiers that a reader from the field would have to learn.

use super::sources::{Source, is_for_tests};
use proc_macro2::{TokenStream, TokenTree};
use quote::ToTokens;
use std::collections::BTreeSet;
use syn::visit_mut::{self, VisitMut};

/// Words that no identifier may hold as one of its words, with the field's word for it.
const WORDS: [(&[&str], &str); 32] = [
    (
        &["seat", "seats", "seating", "unseated"],
        "active object, active set",
    ),
    (&["placing", "placings"], "object instance"),
    (&["tally", "tallies"], "statistics"),
    (&["desk"], "tick context"),
    (&["shelf", "shelves"], "entry of the base mesh store"),
    (
        &["feel", "feels", "felt", "unfelt", "feeler", "feelers"],
        "contact, perception limit",
    ),
    (&["follower", "followers", "followed"], "proxy, proxy step"),
    (&["manner"], "transition"),
    (&["flight", "flights", "fly", "flies", "flying"], "geomorph"),
    (&["soften", "softened"], "tighten"),
    (&["begun"], "partial collection"),
    (&["corridor", "stray"], "look-ahead tube, validity margin"),
    (
        &["haste", "thrift", "dearness", "owed"],
        "peak step, look-ahead scale, last cost",
    ),
    (&["stretched", "gently"], "coupling deflection, rate limit"),
    (
        &["cushion", "thickness"],
        "minimum separation, contact offset",
    ),
    (&["caught", "disturbance"], "stuck, mesh change"),
    (
        &["dial", "economy", "rung", "rungs", "ladder"],
        "LOD controller, level",
    ),
    (&["linger", "lingers"], "hysteresis"),
    (&["forgive", "forgiven", "lonely"], "retry, station absent"),
    (&["rolling"], "path generator"),
    (&["tape"], "input recording"),
    (&["kick", "kicks"], "force discontinuity"),
    (&["gate", "gates"], "force limiter"),
    (&["resists", "drives"], "passive wrench, active wrench"),
    (&["rim", "rims"], "boundary"),
    (&["maker", "makers"], "creator"),
    (&["hull", "hulls"], "descendant bounds"),
    (&["lacking", "belief"], "missing, assumed resident"),
    (&["cleared"], "empty"),
    (&["way", "ways"], "displacement, path, direction"),
    (&["takeoff", "touchdown"], "start, finish"),
    (&["patience"], "timeout"),
];

/// Whole names that are private; their single words are not.
const NAMES: [(&str, &str); 17] = [
    ("Beside", "contact forecast"),
    ("let_go", "unload"),
    ("take_off", "start"),
    ("land", "finish"),
    ("land_at_once", "finish"),
    ("send_home", "reverse"),
    ("ground", "cancel"),
    ("put_out", "depenetrate"),
    ("bound_for", "coupling target"),
    ("is_guess", "is_estimate"),
    ("learn", "insert"),
    ("gather", "collect candidates"),
    ("renew", "update"),
    ("forget", "invalidate"),
    ("say", "limit"),
    ("has_the_word", "has quota"),
    ("in_flight", "geomorphing"),
];

/// The private words among the identifiers of a file that the product names: functions, fields,
/// variables, types, modules and constants; not what other crates name.
pub fn private_words(file: &Source) -> Vec<String> {
    let mut syntax = file.syntax.clone();
    WithoutTests.visit_file_mut(&mut syntax);
    let mut names = BTreeSet::new();
    collect(syntax.to_token_stream(), &mut names);
    let stem = file
        .shown
        .rsplit('/')
        .next()
        .unwrap_or("")
        .trim_end_matches(".rs");
    names.insert(stem.to_string());
    let mut found = Vec::new();
    for name in names {
        if let Some((_, better)) = NAMES.iter().find(|(private, _)| *private == name) {
            found.push(format!("{}: {name}: {better}", file.shown));
        }
        if name.starts_with("MOST_") || name.starts_with("LEAST_") {
            found.push(format!("{}: {name}: MAX_ or MIN_", file.shown));
        }
        for word in words_of(&name) {
            if let Some((_, better)) = WORDS.iter().find(|(of, _)| of.contains(&word.as_str())) {
                found.push(format!("{}: {name}: {better}", file.shown));
            }
        }
    }
    found
}

/// Leaves out what is compiled for tests only.
struct WithoutTests;

impl VisitMut for WithoutTests {
    fn visit_file_mut(&mut self, file: &mut syn::File) {
        file.items.retain(|item| !is_test_item(item));
        visit_mut::visit_file_mut(self, file);
    }

    fn visit_attributes_mut(&mut self, attributes: &mut Vec<syn::Attribute>) {
        attributes.clear();
    }
}

fn is_test_item(item: &syn::Item) -> bool {
    match item {
        syn::Item::Mod(item) => is_for_tests(&item.attrs),
        syn::Item::Fn(item) => is_for_tests(&item.attrs),
        syn::Item::Impl(item) => is_for_tests(&item.attrs),
        syn::Item::Use(item) => is_for_tests(&item.attrs),
        _ => false,
    }
}

fn collect(tokens: TokenStream, names: &mut BTreeSet<String>) {
    for token in tokens {
        match token {
            TokenTree::Group(group) => collect(group.stream(), names),
            TokenTree::Ident(ident) => {
                names.insert(ident.to_string());
            }
            _ => {}
        }
    }
}

/// The words of `snake_case`, `SCREAMING_CASE` and `CamelCase`, in lower case.
fn words_of(name: &str) -> Vec<String> {
    let mut words = Vec::new();
    for part in name.split('_').filter(|part| !part.is_empty()) {
        if part.chars().all(|c| !c.is_lowercase()) {
            words.push(part.to_lowercase());
            continue;
        }
        let mut word = String::new();
        for c in part.chars() {
            if c.is_uppercase() && !word.is_empty() {
                words.push(std::mem::take(&mut word));
            }
            word.extend(c.to_lowercase());
        }
        words.push(word);
    }
    words
}

#[test]
fn names_are_taken_apart() {
    assert_eq!(words_of("most_seats"), ["most", "seats"]);
    assert_eq!(words_of("MAX_WAYS"), ["max", "ways"]);
    assert_eq!(words_of("ForceLimiter"), ["force", "limiter"]);
}
