//! What the process of a tunnel tells: its own sentences, and those that it makes of zenoh's log,
//! each once, and again with their number when it is ten times as many.

use crate::named::{ENDED, LINKED_FROM, LOST};
use crate::refusals;
use crate::settings::End;
use crate::words::Word;
use iceoryx2::prelude::{LogLevel, set_logger};
use iceoryx2_log::Log;
use std::collections::BTreeMap;
use std::fmt;
use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};
use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::{Context, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

/// Different sentences at the most: whoever calls must not fill memory.
const MAX_NOTED: usize = 64;
/// A sentence is told again when there were so many times as many.
const TOLD_AGAIN: u64 = 10;

/// Sentences for the user, on standard output.
#[derive(Debug, Clone, Default)]
pub struct Notes {
    noted: Arc<Mutex<BTreeMap<String, Noted>>>,
}

/// How often there was a reason for a sentence, and at how many it is told next.
#[derive(Debug, Clone, Copy)]
struct Noted {
    count: u64,
    next: u64,
}

impl Notes {
    /// It carries topics from now on.
    pub fn ready(&self) {
        tell(&Word::Ready);
    }

    /// Why it ends.
    pub fn failed(&self, sentence: &str) {
        tell(&Word::Failed(sentence.to_owned()));
    }

    /// A sentence that there is a reason for once more.
    pub fn counted(&self, sentence: &str) {
        if let Some(count) = self.count(sentence) {
            let times = match count {
                1 => String::new(),
                _ => format!(" ({count} times so far)"),
            };
            tell(&Word::Note(format!("{sentence}{times}")));
        }
    }

    /// Counts it; the count, when it is to be told.
    fn count(&self, sentence: &str) -> Option<u64> {
        let mut noted = self.noted.lock().unwrap_or_else(PoisonError::into_inner);
        if noted.len() >= MAX_NOTED && !noted.contains_key(sentence) {
            return None;
        }
        let first = Noted { count: 0, next: 1 };
        let of = noted.entry(sentence.to_owned()).or_insert(first);
        of.count += 1;
        let is_told = of.count >= of.next;
        if is_told {
            of.next = TOLD_AGAIN * of.count;
        }
        is_told.then_some(of.count)
    }

    /// A link that began or ended; what was told before is told again after it, when there is a
    /// reason.
    fn link(&self, sentence: String) {
        let mut noted = self.noted.lock().unwrap_or_else(PoisonError::into_inner);
        for of in noted.values_mut() {
            of.next = of.count + 1;
        }
        tell(&Word::Note(sentence));
    }

    /// Makes sentences of zenoh's log; HRTC_LOG shows the log itself too.
    pub fn listen_to_logs(&self, end: &End) {
        let asked = std::env::var("HRTC_LOG").ok();
        let asked = asked.and_then(|level| level.parse::<LevelFilter>().ok());
        let lines = asked.map(|level| {
            tracing_subscriber::fmt::layer()
                .with_writer(std::io::stderr)
                .with_ansi(false)
                .with_filter(level)
        });
        // Another one is there already only in tests.
        let _ = tracing_subscriber::registry()
            .with(lines)
            .with(self.refusals(end))
            .try_init();
    }

    /// How often there was a reason for a sentence with these words.
    #[cfg(test)]
    pub fn counted_so_far(&self, words: &str) -> u64 {
        let noted = self.noted.lock().unwrap_or_else(PoisonError::into_inner);
        let with_words = noted
            .iter()
            .filter(|(sentence, _)| sentence.contains(words));
        with_words.map(|(_, of)| of.count).sum()
    }

    /// Makes sentences of the refusals in zenoh's log, as one end of a link.
    pub(crate) fn refusals<S>(&self, end: &End) -> impl Layer<S> + use<S>
    where
        S: Subscriber + for<'a> LookupSpan<'a>,
    {
        let refusals = Refusals {
            notes: self.clone(),
            end: end.clone(),
        };
        refusals.with_filter(Targets::new().with_targets(refusals::TARGETS))
    }

    /// Makes sentences of iceoryx2's log; HRTC_LOG=debug shows the log itself too.
    pub fn listen_to_iceoryx(&self) {
        // It is read until the process ends.
        set_logger(Box::leak(Box::new(OfIceoryx(self.clone()))));
    }

    /// Tells who is there, who comes and who goes.
    pub fn listen_to_links(&self, session: &Session, end: &End) {
        let notes = self.clone();
        let (end, other) = (end.clone(), end.role().other().name());
        let info = session.info();
        let listener = info
            .link_events_listener()
            .history(true)
            .callback(move |event| {
                let there = event.link().dst().address().to_string();
                notes.link(match (event.kind(), &end) {
                    (SampleKind::Put, End::Listen(_)) => {
                        format!("a {other} {LINKED_FROM} {there}")
                    }
                    (SampleKind::Put, End::Call(to)) => format!("linked to the {other} at {to}"),
                    (SampleKind::Delete, End::Listen(_)) => {
                        format!("the link of the {other} at {there} {ENDED}")
                    }
                    (SampleKind::Delete, End::Call(to)) => {
                        format!("the link to the {other} at {to} {LOST}")
                    }
                });
            });
        if let Err(error) = listener.background().wait() {
            self.counted(&format!("links will not be told ({error})"));
        }
    }
}

/// Nobody may be left to read it.
fn tell(word: &Word) {
    let mut out = std::io::stdout().lock();
    let _ = writeln!(out, "{word}").and_then(|()| out.flush());
}

/// Iceoryx2's log, read for topics in trouble.
struct OfIceoryx(Notes);

impl Log for OfIceoryx {
    fn log(&self, level: LogLevel, origin: fmt::Arguments<'_>, message: fmt::Arguments<'_>) {
        if let Some(sentence) = refusals::of_iceoryx(&message.to_string()) {
            self.0.counted(sentence);
        }
        tracing::debug!("iceoryx2, {level:?}: {origin}: {message}");
    }
}

/// Zenoh's log, read for refusals.
struct Refusals {
    notes: Notes,
    end: End,
}

impl<S: Subscriber> Layer<S> for Refusals {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let mut message = Message::default();
        event.record(&mut message);
        let target = event.metadata().target();
        if let Some(sentence) = refusals::sentence(&self.end, target, &message.0) {
            self.notes.counted(&sentence);
        }
    }
}

/// The message of a log event.
#[derive(Default)]
struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sentence_is_told_again_when_it_is_ten_times_as_many_and_after_a_link() {
        let notes = Notes::default();
        let told = |times: u64| -> Vec<u64> {
            let told = (0..times).filter_map(|_| notes.count("refused"));
            told.collect()
        };
        assert_eq!(told(99), [1, 10]);
        assert_eq!(told(2), [100]);
        notes.link("linked".to_owned());
        assert_eq!(told(3), [102]);
        assert_eq!(notes.counted_so_far("refu"), 104);
    }

    #[test]
    fn whoever_calls_does_not_fill_memory() {
        let notes = Notes::default();
        let told = (0..1000).filter_map(|number| notes.count(&format!("sentence {number}")));
        assert_eq!(told.count(), MAX_NOTED);
        assert_eq!(notes.count("sentence 0"), None);
        assert_eq!(notes.counted_so_far("sentence 0"), 2);
    }
}
