//! Answers of the station: closures and records of requested regions into the cache.

use super::chunk::InboxChunk;
use super::link_meter::LinkMeter;
use super::session::{Receiver, Session, Taken, TickContext};
use crate::budget::Budget;
use crate::cache::{AfterUnload, Cache, LoadError};
use crate::lod::front::Front;
use crate::tuning::streaming::{IDS_AT_ONCE, UNITS_PER_ITEM};
use protocol::{AnswerItem, AnswersReader, PartHead};
use spm::VspRecord;

/// Work units of an item.
fn cost_of(item: &AnswerItem) -> u32 {
    match item {
        AnswerItem::Part(_) => 1,
        AnswerItem::Id { .. } => 2 * UNITS_PER_ITEM,
        AnswerItem::Record(_) => UNITS_PER_ITEM,
        AnswerItem::End(_) => 0,
    }
}

/// The requested region that a part belongs to; parts of others, and of answers whose first part
/// was not taken, are skipped.
fn receiving(cache: &Cache, head: &PartHead) -> Option<usize> {
    let index = cache.requested((head.region, head.tolerance_bits))?;
    cache.regions.at(index).is_receiving().then_some(index)
}

impl Session {
    pub(super) fn take_answers(
        &mut self,
        chunk: &InboxChunk,
        of: &mut Receiver<'_>,
        context: &mut TickContext<'_, '_>,
    ) -> Taken {
        let tick = context.tick;
        let budget = &mut *context.budget;
        let whole_chunk = AnswersReader::new(chunk.header.count);
        let mut reader = self.progress.reader.unwrap_or(whole_chunk);
        // One item is taken in any case, so that a machine that is always late gets on.
        let mut has_taken = false;
        loop {
            // Everything before is done; an item that has to wait is read again.
            self.progress.reader = Some(reader);
            let item = match reader.next(&chunk.slots) {
                Ok(Some(item)) => item,
                Ok(None) => return Taken::Whole,
                Err(_) => return Taken::Gap,
            };
            let cost = cost_of(&item);
            if budget.ingest < cost || (has_taken && budget.is_over()) {
                budget.end_ingest();
                return Taken::Part;
            }
            if let AnswerItem::Part(head) = item {
                budget.ingest -= cost;
                has_taken = true;
                self.progress.done += 1;
                self.begin_answer(&head, of.front, context.meter, tick);
                continue;
            }
            let Some(region) = receiving(&of.front.cache, reader.head()) else {
                reader.skip_part();
                continue;
            };
            if matches!(item, AnswerItem::Record(_))
                && !of.front.cache.has_slot()
                && !of.front.make_room(region, tick, budget, of.contacts)
            {
                if self.progress.waited < self.max_room_wait {
                    return Taken::Part;
                }
                self.give_up(region, of.front, (tick, budget));
                continue;
            }
            budget.ingest -= cost;
            has_taken = true;
            let taken = self.take_item(&item, (chunk, &mut reader), region, of, (tick, budget));
            if taken.is_ok() && matches!(item, AnswerItem::End(head) if head.is_last()) {
                context.meter.region_ended();
            }
            match (taken, item) {
                (Ok(()), _) => self.progress.done += 1,
                (Err(LoadError::NoRoom), AnswerItem::Record(_)) => return Taken::Part,
                (Err(LoadError::NoRoom), _) => self.give_up(region, of.front, (tick, budget)),
                (Err(LoadError::Unfinished), _) => {
                    budget.end_ingest();
                    return Taken::Part;
                }
                (Err(LoadError::Gap), _) => self.ask_again(region, of.front, tick),
                (Err(LoadError::Damaged), _) => {
                    self.refuse(region, of.front, (AfterUnload::Reject, tick));
                }
            }
            // What was given up makes room for what follows.
            of.front.cache.go_on_unloading(&mut budget.upkeep);
        }
    }

    /// Takes an item of the answer to a region.
    fn take_item(
        &mut self,
        item: &AnswerItem,
        (chunk, reader): (&InboxChunk, &mut AnswersReader),
        region: usize,
        of: &mut Receiver<'_>,
        (tick, budget): (u64, &mut Budget),
    ) -> Result<(), LoadError> {
        let cache = &mut of.front.cache;
        match item {
            AnswerItem::Id { id, record_follows } => {
                take_ids(cache, chunk, region, (*id, *record_follows), reader)
            }
            AnswerItem::Record(record) => self.take_record(cache, region, record, budget),
            AnswerItem::End(head) if head.is_last() => {
                cache.end_answer(region)?;
                self.subscriber.answered(cache.regions.at(region).key);
                of.front.region_arrived(region, tick);
                Ok(())
            }
            AnswerItem::End(_) | AnswerItem::Part(_) => Ok(()),
        }
    }

    fn take_record(
        &mut self,
        cache: &mut Cache,
        region: usize,
        record: &VspRecord,
        budget: &mut Budget,
    ) -> Result<(), LoadError> {
        cache.load(region, record, &mut budget.upkeep)?;
        self.vsps_received += 1;
        // A record costs about half an operation: one budget for both keeps ticks even.
        let cost = (self.progress.done % 2) as u32;
        budget.operations = budget.operations.saturating_sub(cost);
        Ok(())
    }

    /// Gives up a requested region for lack of room.
    fn give_up(&mut self, region: usize, front: &mut Front, (tick, budget): (u64, &mut Budget)) {
        self.subscriber.answered(front.cache.regions.at(region).key);
        // The next region waits its own time.
        self.progress.waited = 0;
        front.unload(region, tick, budget);
        front.starve(tick);
    }

    /// A part begins, and with it the answer, if it is the first part.
    fn begin_answer(
        &mut self,
        head: &PartHead,
        front: &mut Front,
        meter: &mut LinkMeter,
        tick: u64,
    ) {
        let region = front.cache.requested((head.region, head.tolerance_bits));
        let (true, Some(region)) = (head.is_first(), region) else {
            return;
        };
        let key = front.cache.regions.at(region).key;
        if let Some(periods) = self.subscriber.answer_begins(key, meter.clock(tick)) {
            meter.answered(periods, tick);
        }
        if front.cache.begin_answer(region).is_err() {
            self.ask_again(region, front, tick);
        }
    }

    /// The answer to a requested region builds on evicted records, or has a gap: it is to be
    /// requested with every record. If it was already, what the station has is inconsistent: asked
    /// for at once it would come again as it is.
    fn ask_again(&mut self, region: usize, front: &mut Front, tick: u64) {
        let key = front.cache.regions.at(region).key;
        if self.subscriber.questions().is_lost(key) {
            return self.refuse(region, front, (AfterUnload::Reject, tick));
        }
        self.subscriber.answer_is_lost(key);
        let cache = &mut front.cache;
        cache.begin_unload(region, AfterUnload::RequestAgain, tick);
    }
}

/// Takes an id of a closure, and those that come right after it.
fn take_ids(
    cache: &mut Cache,
    chunk: &InboxChunk,
    region: usize,
    (id, record_follows): (u32, bool),
    reader: &mut AnswersReader,
) -> Result<(), LoadError> {
    cache.add_to_closure(region, id, record_follows)?;
    for _ in 1..IDS_AT_ONCE {
        let mut ahead = *reader;
        let Ok(Some(AnswerItem::Id { id, record_follows })) = ahead.next(&chunk.slots) else {
            break;
        };
        cache.add_to_closure(region, id, record_follows)?;
        *reader = ahead;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::{RegionKey, RegionState};
    use crate::horizons::Horizons;
    use crate::lod::predictions::Unknown;
    use crate::streaming::Outbox;
    use crate::streaming::subscriber::Identity;
    use protocol::RegionAction;
    use scene::{NoFiles, Overrides, parse};

    /// One whose records do not fit each other: asked for without end it would take the whole link.
    #[test]
    fn a_whole_answer_that_is_of_no_use_is_not_asked_for_at_once() {
        let text = "[[object]]\nmodel = \"ball.spm\"\nsize_m = 0.1\n[[probe]]\n";
        let plan = parse(text, "test", "".as_ref(), &Overrides::default(), &NoFiles)
            .expect("the scene is good");
        let horizons = Horizons::new(1000.0);
        let identity = Identity {
            client: 7,
            incarnation: 8,
        };
        let mut front = Front::new(&plan, 4 << 20);
        let mut session = Session::new(identity, &horizons);
        let meter = LinkMeter::new(&horizons);
        let mut outbox = Outbox::new(1);
        let key = RegionKey::prefix(9);
        let wanted = Unknown {
            key,
            due: 0.0,
            leaves: 1e9,
            is_needed: true,
            predicted: 0,
        };
        let tick = 10;
        session
            .subscriber
            .observe(1, tick, &meter, &mut front.cache);
        session.subscriber.model_is(5);
        let mut asked = Vec::new();
        for _ in 0..3 {
            let mut entries = u32::MAX;
            front.cache.go_on_unloading(&mut entries);
            outbox.clear();
            outbox.begin_session(0);
            let wanted = std::iter::once(wanted);
            let cache = &mut front.cache;
            session
                .subscriber
                .requests(tick, cache, wanted, &meter, &mut outbox);
            for of in outbox.requests() {
                asked.extend(of.regions[..of.count as usize].iter().map(|of| of.action));
            }
            if let Some(region) = front.cache.requested((key.id.0, key.tolerance_bits)) {
                session.ask_again(region, &mut front, tick);
            }
        }
        let due = [RegionAction::Subscribe, RegionAction::Resend];
        assert_eq!(asked, due.map(|of| of as u32));
        assert_eq!(front.refused_regions, 1);
        let region = front.cache.regions.index(key).expect("it is known");
        let state = front.cache.regions.at(region).state();
        assert_eq!(state, RegionState::Refused);
        assert!(session.subscriber.questions().all().is_empty());
    }
}
