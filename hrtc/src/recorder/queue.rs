//! A bounded queue between two threads that may allocate: it takes memory for what waits in it,
//! where a ring, touched and locked whole at the start, takes it for all that ever might.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// A queue for so many entries.
pub(super) fn bounded<T>(capacity: usize) -> (Sender<T>, Receiver<T>) {
    let (entries, waiting_entries) = mpsc::channel();
    let waiting = Arc::new(AtomicUsize::new(0));
    let sender = Sender {
        entries,
        waiting: Arc::clone(&waiting),
        capacity,
    };
    let receiver = Receiver {
        entries: waiting_entries,
        waiting,
        next: None,
    };
    (sender, receiver)
}

/// The end that adds.
pub(super) struct Sender<T> {
    entries: mpsc::Sender<T>,
    waiting: Arc<AtomicUsize>,
    capacity: usize,
}

impl<T> Sender<T> {
    /// Adds an entry; whether there was room for it, and still a receiver.
    pub(super) fn push(&mut self, entry: T) -> bool {
        // Only this end adds, so that the count read here can only have fallen since.
        if self.waiting.load(Ordering::Acquire) >= self.capacity {
            return false;
        }
        self.waiting.fetch_add(1, Ordering::AcqRel);
        self.entries.send(entry).is_ok()
    }
}

/// The end that takes.
pub(super) struct Receiver<T> {
    entries: mpsc::Receiver<T>,
    waiting: Arc<AtomicUsize>,
    /// Looked at and not yet taken.
    next: Option<T>,
}

impl<T> Receiver<T> {
    /// Entries that wait.
    pub(super) fn len(&self) -> usize {
        self.waiting.load(Ordering::Acquire)
    }

    /// Takes the oldest entry if it is as asked for.
    pub(super) fn pop_if(&mut self, is_wanted: impl FnOnce(&T) -> bool) -> Option<T> {
        if self.next.is_none() {
            self.next = self.entries.try_recv().ok();
        }
        let taken = self.next.take_if(|entry| is_wanted(entry))?;
        self.waiting.fetch_sub(1, Ordering::AcqRel);
        Some(taken)
    }

    /// Takes the oldest entry.
    pub(super) fn pop(&mut self) -> Option<T> {
        self.pop_if(|_| true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_come_in_order_and_what_finds_no_room_is_lost() {
        let (mut sender, mut receiver) = bounded(2);
        assert!(sender.push(1) && sender.push(2));
        assert!(!sender.push(3));
        assert_eq!(receiver.len(), 2);
        assert_eq!(receiver.pop_if(|&entry| entry > 1), None);
        // What was looked at only still waits.
        assert_eq!(receiver.len(), 2);
        assert!(!sender.push(4));
        assert_eq!(receiver.pop(), Some(1));
        assert!(sender.push(5));
        assert_eq!(
            [receiver.pop(), receiver.pop(), receiver.pop()],
            [Some(2), Some(5), None]
        );
        assert_eq!(receiver.len(), 0);
    }

    #[test]
    fn without_a_receiver_nothing_is_taken() {
        let (mut sender, receiver) = bounded(2);
        drop(receiver);
        assert!(!sender.push(1));
    }
}
