//! What the process of a tunnel tells: its own sentences, and those that it makes of zenoh's log,
//! each once.

use crate::refusals;
use crate::settings::End;
use crate::words::Word;
use iceoryx2::prelude::{LogLevel, set_logger};
use iceoryx2_log::Log;
use std::collections::BTreeSet;
use std::fmt;
use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};
use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::{Context, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

/// Different sentences at the most: whoever calls must not fill memory.
const MAX_NOTED: usize = 64;

/// Sentences for the user, on standard output.
#[derive(Debug, Clone, Default)]
pub struct Notes {
    noted: Arc<Mutex<BTreeSet<String>>>,
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

    /// A sentence, unless it was told since a link began or ended.
    pub fn once(&self, sentence: &str) {
        let mut noted = self.noted.lock().unwrap_or_else(PoisonError::into_inner);
        if noted.len() < MAX_NOTED && noted.insert(sentence.to_owned()) {
            tell(&Word::Note(sentence.to_owned()));
        }
    }

    /// A link that began or ended; what was told before may be told again after it.
    fn link(&self, sentence: String) {
        let mut noted = self.noted.lock().unwrap_or_else(PoisonError::into_inner);
        noted.clear();
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
        let refusals = Refusals {
            notes: self.clone(),
            end: end.clone(),
        };
        let refusals = refusals.with_filter(Targets::new().with_targets(refusals::TARGETS));
        // Another one is there already only in tests.
        let _ = tracing_subscriber::registry()
            .with(lines)
            .with(refusals)
            .try_init();
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
                        format!("a {other} is linked from {there}")
                    }
                    (SampleKind::Put, End::Call(to)) => format!("linked to the {other} at {to}"),
                    (SampleKind::Delete, End::Listen(_)) => {
                        format!("the link of the {other} at {there} has ended")
                    }
                    (SampleKind::Delete, End::Call(to)) => {
                        format!("the link to the {other} at {to} was lost; it is called again")
                    }
                });
            });
        if let Err(error) = listener.background().wait() {
            self.once(&format!("links will not be told ({error})"));
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
            self.0.once(sentence);
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
            self.notes.once(&sentence);
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
