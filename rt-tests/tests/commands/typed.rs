//! A command as a user types it, and what it gives back.
#![allow(dead_code, reason = "two test programs use it, each another part")]

use serde_json::Value;
use std::process::{Command, Output, Stdio};

/// `rt-tests` with built models kept in cargo's folder for tests, not in the user's cache.
pub fn rt_tests(command: &str) -> Command {
    let mut typed = Command::new(env!("CARGO_BIN_EXE_rt-tests"));
    let cache = concat!(env!("CARGO_TARGET_TMPDIR"), "/models");
    typed
        .arg(command)
        .env("HRTC_CACHE", cache)
        .stdin(Stdio::null());
    typed
}

/// Everything that a command said on standard error.
pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The one JSON object on standard output.
pub fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", said(output)))
}

/// A number at a path such as `dial.asked_over_true_p50`.
pub fn number(value: &Value, path: &str) -> f64 {
    let found = path.split('.').fold(value, |value, key| &value[key]);
    found
        .as_f64()
        .unwrap_or_else(|| panic!("{path} is no number in {value}"))
}

/// The last line on standard error, which must be one sentence, of a command that ended with status
/// 2.
pub fn refusal(output: &Output) -> String {
    let said = said(output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(output.stdout.is_empty(), "nothing on standard output");
    let errors: Vec<&str> = said
        .lines()
        .filter(|line| line.starts_with("error: "))
        .collect();
    assert_eq!(errors.len(), 1, "one error line: {said}");
    assert_eq!(said.lines().last(), Some(errors[0]), "{said}");
    errors[0].to_string()
}
