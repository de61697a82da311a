//! What serde refuses in a scene's text, in the words of a scene: the key, what stands there and
//! what to write. Serde itself names its own types.

use std::ops::Range;

/// Characters of a value that a sentence shows at the most.
const SHOWN: usize = 40;

/// A sentence for serde's message about a part of the text.
pub(crate) fn sentence(text: &str, place: Option<Range<usize>>, message: &str) -> String {
    let told = place.and_then(|place| told(text, place, message));
    told.unwrap_or_else(|| message.replace('\n', "; "))
}

/// The sentence for a message of a known kind.
fn told(text: &str, place: Range<usize>, message: &str) -> Option<String> {
    let key = key_before(text, place.start);
    let value = text.get(place)?;
    let table = key.unwrap_or("this table");
    if let Some(missing) = message.strip_prefix("missing field ") {
        return Some(format!("{table} has no {missing}; write it too"));
    }
    if message.starts_with("string values must be quoted") {
        return Some(
            "this is no value; write a text in quotes, and a number alone: its key names the unit"
                .to_owned(),
        );
    }
    match message {
        "wanted exactly 1 element, found 0 elements" => {
            return Some(format!("{table} is empty; write in it what it is"));
        }
        "wanted exactly 1 element, more than 1 element" => {
            return Some(format!(
                "{table} is of one kind only and names more; leave one of them and take the others out"
            ));
        }
        _ => {}
    }
    let is_kind = message == "wanted string or table";
    if key.is_none()
        && (is_kind || message.starts_with("invalid type: "))
        && let Some(sentence) = header(value, message)
    {
        return Some(sentence);
    }
    let key = key.unwrap_or("this");
    let shown = shown(value);
    if is_kind {
        return Some(format!(
            "{key} is {shown}; write a name in quotes or a table in braces"
        ));
    }
    let refused = ["invalid type: ", "invalid length "];
    refused.iter().find(|&&of| message.starts_with(of))?;
    let (_, expected) = message.rsplit_once(", expected ")?;
    if expected == "newtype variant" {
        let name = value.trim_matches(['"', '\'']);
        return Some(format!(
            "{key} is only the name {shown}; write what belongs to it too: {key} = {{ {name} = ... }}"
        ));
    }
    let wanted = wanted(expected)?;
    Some(format!("{key} is {shown}; write {wanted}"))
}

/// The sentence for the header of a table with too few brackets or too many, which serde takes for
/// something else than what its key is.
fn header(value: &str, message: &str) -> Option<String> {
    let inside = |open: &str, close: &str| value.strip_prefix(open)?.strip_suffix(close);
    if let Some(name) = inside("[[", "]]") {
        return Some(format!(
            "[[{name}]] begins one of several tables, but there is only one of it; write [{name}]"
        ));
    }
    // Where no list is expected, more brackets are no help.
    let name = inside("[", "]").filter(|_| message.ends_with(", expected a sequence"))?;
    Some(format!(
        "[{name}] begins the only table of its name, but there may be several; write [[{name}]]"
    ))
}

/// What serde expects, as people write it.
fn wanted(expected: &str) -> Option<String> {
    let wanted = match expected {
        "f64" => "a number without quotes",
        "i64" => "a whole number without quotes or a point",
        "a boolean" => "true or false without quotes",
        "a string" => "a text in quotes",
        "a sequence" => "a list in brackets",
        "a map" => "a table in braces",
        _ if expected.starts_with("struct ") => "a table in braces",
        _ if expected.starts_with("a size ") => expected,
        _ => {
            // Every array of a scene is one of numbers.
            let count = expected.strip_prefix("an array of length ")?;
            return Some(format!("{count} numbers in brackets"));
        }
    };
    Some(wanted.to_owned())
}

/// A value for a sentence: one line, not long.
fn shown(value: &str) -> String {
    let line = value.lines().next().unwrap_or("");
    let end = line.char_indices().nth(SHOWN).map(|(end, _)| end);
    let start = &line[..end.unwrap_or(line.len())];
    let more = if start.len() < value.trim_end().len() {
        "..."
    } else {
        ""
    };
    format!("{start}{more}")
}

/// The key whose value begins at this byte, or holds what begins there in a list.
fn key_before(text: &str, at: usize) -> Option<&str> {
    let mut before = text.get(..at)?.trim_end_matches([' ', '\t']);
    while !before.ends_with('=') {
        before = before[..open_bracket(before)?].trim_end_matches([' ', '\t']);
    }
    let key = before.strip_suffix('=')?.trim_end_matches([' ', '\t']);
    let is_part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.');
    let key = key.rsplit(|c: char| !is_part(c)).next()?;
    (!key.is_empty()).then_some(key)
}

/// Where the last bracket stands that is open at the end of a text.
fn open_bracket(text: &str) -> Option<usize> {
    let mut closed = 0usize;
    for (at, c) in text.char_indices().rev() {
        match c {
            ']' => closed += 1,
            '[' if closed == 0 => return Some(at),
            '[' => closed -= 1,
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NoFiles, Overrides, parse};
    use std::path::Path;

    const OBJECT: &str = "[[object]]\nmodel = \"m.spm\"\nsize_m = 0.1\n";

    /// How a scene is refused whose object has a line more, the fourth, and whose probe one, the
    /// sixth.
    fn refusal(of_object: &str, of_probe: &str) -> String {
        let text = format!("{OBJECT}{of_object}\n[[probe]]\n{of_probe}\n");
        let none = Overrides::default();
        let refused = parse(&text, "s", Path::new(""), &none, &NoFiles);
        refused.unwrap_err().0
    }

    #[test]
    fn what_is_typed_wrong_in_a_probe_is_named_with_its_key_and_what_to_write() {
        for (of_probe, says) in [
            (
                r#"shape = "sphere""#,
                r#"shape is only the name "sphere"; write what belongs to it too: shape = { sphere = ... }"#,
            ),
            (
                "shape = { sphere = {}, capsule = { radius_m = 1, length_m = 3 } }",
                "shape is of one kind only and names more; leave one of them",
            ),
            ("shape = {}", "shape is empty; write in it what it is"),
            ("shape = 5", "shape is 5; write a name in quotes or a table"),
            (
                "shape = { sphere = 0.01 }",
                "sphere is 0.01; write a table in braces",
            ),
            (
                "shape = { cylinder = { radius_m = 0.01 } }",
                "cylinder has no `length_m`; write it too",
            ),
            (
                r#"shape = { sphere = { radius_m = "0.01" } }"#,
                r#"radius_m is "0.01"; write a number without quotes"#,
            ),
            (
                "trajectory = { tour = { seed = 1.5 } }",
                "seed is 1.5; write a whole number",
            ),
            (
                "trajectory = { csv = 3 }",
                "csv is 3; write a text in quotes",
            ),
        ] {
            let said = refusal("", of_probe);
            assert!(said.starts_with(&format!("s, line 6: {says}")), "{said}");
        }
    }

    #[test]
    fn what_is_typed_wrong_elsewhere_is_named_with_its_key_and_what_to_write() {
        for (of_object, says) in [
            (
                "pose = { position_m = [0, 0] }",
                "position_m is [0, 0]; write 3 numbers in brackets",
            ),
            (
                "pose = { position_m = [0, 0, 0, 5] }",
                "position_m is [0, 0, 0, 5]; write 3 numbers in brackets",
            ),
            (
                "pose = { orientation_wxyz = [1, 0, 0, 0, 0] }",
                "orientation_wxyz is [1, 0, 0, 0, 0]; write 4 numbers",
            ),
            (
                "grid = { counts = [2, 2, 1, 9], spacing_m = 0.2 }",
                "counts is [2, 2, 1, 9]; write 3 numbers",
            ),
            (
                "movable = { rail = { axis = [0, 0, 1], mass_kg = 1, limits_m = [-1, 0, 1] } }",
                "limits_m is [-1, 0, 1]; write 2 numbers",
            ),
            (
                r#"pose = { position_m = [0, "x", 0] }"#,
                r#"position_m is "x"; write a number"#,
            ),
            (
                "pose = { position_m = 7 }",
                "position_m is 7; write 3 numbers in brackets",
            ),
            ("effects = 1", "effects is 1; write a list in brackets"),
            ("surface = 800", "surface is 800; write a table in braces"),
        ] {
            let said = refusal(of_object, "");
            assert!(said.starts_with(&format!("s, line 4: {says}")), "{said}");
        }
        let said = refusal("[[cache.change]]\nat_s = 1", "");
        let says = "s, line 4: this table has no `bytes`; write it too";
        assert!(said.starts_with(says), "{said}");
        let said = refusal("[cache]\nbytes = 1.5", "");
        assert!(
            said.contains("line 5: bytes is 1.5; write a size"),
            "{said}"
        );
        let said = refusal("[loop]\nrate_hz = \"1000\"", "");
        let says = "s, line 5: rate_hz is \"1000\"; write a number without quotes";
        assert!(said.starts_with(says), "{said}");
    }

    #[test]
    fn a_header_with_too_few_or_too_many_brackets_is_named_with_the_right_ones() {
        for (text, says) in [
            (
                "[object]\nsize_m = 0.1\n[[probe]]\n",
                "line 1: [object] begins",
            ),
            ("[object]\nsize_m = 0.1\n[[probe]]\n", "; write [[object]]"),
            ("[[loop]]\nrate_hz = 500\n", "line 1: [[loop]] begins"),
            ("[[loop]]\nrate_hz = 500\n", "; write [loop]"),
            ("[cache.change]\nat_s = 1\n", "; write [[cache.change]]"),
            ("[[probe]]\n[[probe.device]]\n", "; write [probe.device]"),
            // Nothing of the brackets.
            ("[loop]\n[loop]\n", "duplicate key"),
            ("[[object]]\n[object.model]\n", "write a text in quotes"),
        ] {
            let none = Overrides::default();
            let said = parse(text, "s", Path::new(""), &none, &NoFiles).unwrap_err();
            assert!(said.0.contains(says), "{said}");
        }
    }

    #[test]
    fn what_has_no_quotes_and_is_no_number_is_told_so() {
        let said = refusal("importance = 1 or 2", "");
        assert!(
            said.starts_with("s, line 4: this is no value; write"),
            "{said}"
        );
    }

    #[test]
    fn the_key_of_a_value_is_found_through_lists_and_no_further() {
        let key = |text: &str| key_before(text, text.len()).map(str::to_owned);
        assert_eq!(key("a = 1\nb_m = "), Some("b_m".to_owned()));
        assert_eq!(key("{ x.y="), Some("x.y".to_owned()));
        assert_eq!(key("p = [[0, 1], [2, "), Some("p".to_owned()));
        assert_eq!(key("p = [\n  [0, 1],\n  "), Some("p".to_owned()));
        assert_eq!(key("a = [1]\n"), None);
        assert_eq!(key("# a [sic\n"), None);
        assert_eq!(key("= "), None);
        assert_eq!(key(""), None);
    }

    #[test]
    fn a_long_value_is_cut_and_what_is_unknown_is_passed_on_as_one_line() {
        assert_eq!(shown("1"), "1");
        assert_eq!(shown("[1,\n2]"), "[1,...");
        assert_eq!(shown(&"\u{e9}".repeat(50)), "\u{e9}".repeat(SHOWN) + "...");
        assert_eq!(sentence("a = 1", Some(4..5), "what\nelse"), "what; else");
        // A place that is not in the text.
        let missing = "missing field `b`";
        assert_eq!(sentence("a = 1", None, missing), missing);
        assert_eq!(sentence("a", Some(5..9), missing), missing);
    }
}
