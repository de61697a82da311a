//! A client that keeps the protocol, and the wire to it.

use super::*;

/// A client that keeps the protocol: what a controller must do, in its simplest form.
pub struct Client {
    pub id: u64,
    pub incarnation: u64,
    pub model: u64,
    pub epoch: u32,
    /// Number of the next request, and of the next chunk.
    pub next_request: u64,
    pub next_chunk: u64,
    pub consumed: u64,
    /// Closures of complete regions.
    pub held: BTreeMap<RegionAt, Vec<u32>>,
    /// Regions asked for in this epoch whose answer is not complete.
    pub asked: VecDeque<RegionAt>,
    /// Ids of the answer that is coming in, and whether it is of use.
    pub partial: Option<(RegionAt, Vec<u32>, bool)>,
    pub records: BTreeMap<u32, VspRecord>,
    /// What it asked for and did not give up.
    pub wanted: BTreeSet<RegionAt>,
    /// Answers that counted on records that were gone.
    pub incomplete: u32,
}

impl Client {
    pub fn new(id: u64) -> Self {
        Self {
            id,
            incarnation: 1,
            model: open().model_header().model,
            epoch: 0,
            next_request: 0,
            next_chunk: 0,
            consumed: 0,
            held: BTreeMap::new(),
            asked: VecDeque::new(),
            partial: None,
            records: BTreeMap::new(),
            wanted: BTreeSet::new(),
            incomplete: 0,
        }
    }

    pub fn request(&mut self, kind: RequestKind) -> Request {
        let mut request = Request::zeroed();
        request.client = self.id;
        request.incarnation = self.incarnation;
        request.epoch = self.epoch;
        request.sequence = self.next_request;
        request.consumed = self.consumed;
        request.credit = CREDIT_CHUNKS as u32;
        request.model = self.model;
        request.name = Request::name_hash("torus");
        request.kind = kind as u32;
        self.next_request += 1;
        request
    }

    pub fn regions(&mut self, action: RegionAction, regions: &[RegionAt]) -> Vec<Request> {
        let mut requests = Vec::new();
        for part in regions.chunks(REGIONS_PER_REQUEST) {
            let mut request = self.request(RequestKind::Regions);
            request.count = part.len() as u32;
            for (ask, &region) in request.regions.iter_mut().zip(part) {
                *ask = RegionAsk {
                    region: region.region.0,
                    tolerance_bits: region.tolerance_bits,
                    action: action as u32,
                };
            }
            requests.push(request);
        }
        requests
    }

    pub fn subscribe(&mut self, region: RegionAt) -> Vec<Request> {
        self.wanted.insert(region);
        if self.held.contains_key(&region) || self.asked.contains(&region) {
            return Vec::new();
        }
        self.asked.push_back(region);
        self.regions(RegionAction::Subscribe, &[region])
    }

    /// Gives a region up, asked for or held. Careful clients wait until nothing is open.
    pub fn release(&mut self, region: RegionAt) -> Vec<Request> {
        self.wanted.remove(&region);
        self.asked.retain(|&r| r != region);
        if self.partial.as_ref().is_some_and(|p| p.0 == region) {
            self.partial = None;
        }
        self.held.remove(&region);
        self.drop_unneeded();
        self.regions(RegionAction::Release, &[region])
    }

    pub fn drop_unneeded(&mut self) {
        // What the answer that is coming in lists is held from the moment it is listed.
        let coming = self.partial.iter().flat_map(|(_, closure, _)| closure);
        let needed: BTreeSet<u32> = self
            .held
            .values()
            .flatten()
            .chain(coming)
            .copied()
            .collect();
        self.records.retain(|i, _| needed.contains(i));
    }

    /// Ends the epoch: says what is held, asks again for the rest.
    pub fn new_epoch(&mut self) -> Vec<Request> {
        self.epoch += 1;
        self.next_request = 0;
        self.next_chunk = 0;
        self.consumed = 0;
        self.partial = None;
        self.drop_unneeded();
        let held: Vec<RegionAt> = self.held.keys().copied().collect();
        let mut requests = self.regions(RegionAction::Resident, &held);
        self.asked = self
            .wanted
            .iter()
            .copied()
            .filter(|r| !self.held.contains_key(r))
            .collect();
        let asked: Vec<RegionAt> = self.asked.iter().copied().collect();
        requests.extend(self.regions(RegionAction::Subscribe, &asked));
        requests
    }

    /// Takes a chunk in, and answers what is to be said to it; `None` ends the epoch.
    pub fn receive(&mut self, (header, slots): &Chunk) -> Option<Vec<Request>> {
        let mut said = Vec::new();
        if header.epoch != self.epoch || header.client != self.id {
            return Some(said);
        }
        if header.sequence != self.next_chunk {
            return None;
        }
        self.next_chunk += 1;
        self.consumed += 1;
        assert_eq!(header.kind, ChunkKind::Answers as u32);
        let mut reader = AnswersReader::new(header.count);
        while let Some(item) = reader.next(slots).unwrap() {
            let region = region_of(reader.head());
            match item {
                AnswerItem::Part(head) if head.is_first() && self.asked.contains(&region) => {
                    self.partial = Some((region, Vec::new(), true));
                }
                AnswerItem::Part(_) => {}
                _ if self.partial.as_ref().is_none_or(|(of, ..)| *of != region) => {
                    reader.skip_part();
                }
                AnswerItem::Id { id, record_follows } => {
                    let here = self.records.contains_key(&id);
                    if let Some((_, closure, of_use)) = &mut self.partial {
                        *of_use &= here || record_follows;
                        closure.push(id);
                    }
                }
                AnswerItem::Record(record) => {
                    self.records.insert(record.i, record);
                }
                AnswerItem::End(head) if head.is_last() => {
                    if let Some((_, closure, of_use)) = self.partial.take() {
                        if of_use {
                            self.asked.retain(|&r| r != region);
                            self.held.insert(region, closure);
                        } else {
                            self.incomplete += 1;
                            said.extend(self.regions(RegionAction::Resend, &[region]));
                        }
                    }
                }
                AnswerItem::End(_) => {}
            }
        }
        Some(said)
    }

    /// Holds exactly the union of the closures of what it wants.
    pub fn check(&mut self) {
        let file = open();
        let mut union = BTreeSet::new();
        for &region in &self.wanted {
            let closure = closure(&file, region).unwrap();
            assert_eq!(self.held.get(&region), Some(&closure), "{region}");
            union.extend(closure);
        }
        self.drop_unneeded();
        assert!(self.records.keys().copied().eq(union));
        for (&i, record) in &self.records {
            assert_eq!(*record, file.record(i).unwrap());
        }
    }
}

/// A link with delay in both directions.
#[derive(Default)]
pub struct Wire {
    pub up: VecDeque<Request>,
    pub down: VecDeque<Chunk>,
}

impl Wire {
    pub fn carry_up(&mut self, station: &mut Station<Bytes>, most: usize) {
        for _ in 0..most {
            let Some(request) = self.up.pop_front() else {
                break;
            };
            station.handle(Message::Request(&request));
        }
    }

    pub fn pull(&mut self, station: &mut Station<Bytes>, client: u64, most: usize) {
        for _ in 0..most {
            let Some(chunk) = station.poll(client) else {
                break;
            };
            self.down.push_back(chunk);
        }
    }

    /// All requests up, at most so many answers, and all that is under way down.
    pub fn exchange(&mut self, station: &mut Station<Bytes>, client: &mut Client, most: usize) {
        self.carry_up(station, usize::MAX);
        self.pull(station, client.id, most);
        self.carry_down(client, usize::MAX);
    }

    pub fn carry_down(&mut self, client: &mut Client, most: usize) {
        for _ in 0..most {
            let Some(chunk) = self.down.pop_front() else {
                break;
            };
            let said = client.receive(&chunk);
            self.up.extend(said.unwrap_or_else(|| client.new_epoch()));
        }
    }
}

pub fn region_of(head: &PartHead) -> RegionAt {
    RegionAt {
        region: RegionId(head.region),
        tolerance_bits: head.tolerance_bits,
    }
}
