//! Panics of the tick thread: kept as a message instead of being printed.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::sync::Once;

thread_local! {
    /// Whether panics of this thread are kept for [`message`] instead of being printed.
    static IS_QUIET: Cell<bool> = const { Cell::new(false) };
    /// Place of the last quiet panic in the code.
    static PANICKED_AT: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Keeps panics of this thread from being printed as long as it lives: with a backtrace that takes
/// longer than the wrenches are valid. The run's error tells message and place instead.
pub(super) struct QuietPanics;

impl QuietPanics {
    pub fn begin() -> Self {
        static HOOK: Once = Once::new();
        HOOK.call_once(|| {
            let print = std::panic::take_hook();
            std::panic::set_hook(Box::new(move |panic| {
                if IS_QUIET.get() {
                    PANICKED_AT.set(panic.location().map(ToString::to_string));
                } else {
                    print(panic);
                }
            }));
        });
        IS_QUIET.set(true);
        Self
    }
}

impl Drop for QuietPanics {
    fn drop(&mut self) {
        IS_QUIET.set(false);
    }
}

/// The message of a panic and its place in the code.
pub(super) fn message(payload: Box<dyn Any + Send>) -> String {
    let text = payload
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned());
    let text = text.or_else(|| payload.downcast_ref::<String>().cloned());
    // Another payload's drop may panic again.
    Box::leak(payload);
    let text = text.unwrap_or_else(|| "a panic without a message".to_owned());
    match PANICKED_AT.take() {
        Some(place) => format!("{text} (at {place})"),
        None => text,
    }
}
