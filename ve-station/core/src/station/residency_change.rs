//! Changes of what a client is believed to hold, made a bounded part at a time and before anything
//! is answered, since an answer counts on it.

use super::{SEARCHED_A_STEP, Station};
use crate::collection::{CollectError, RegionAt, Residency, Search};
use protocol::RegionAsk;
use spm::SpmFile;

/// A change that waits or is being made.
#[derive(Debug)]
pub enum ResidencyChange {
    /// The client says that it holds a region.
    Held {
        model: usize,
        ask: RegionAsk,
        change: Option<Change>,
    },
    /// The client has unloaded a region.
    Released {
        model: usize,
        region: RegionAt,
        change: Option<Change>,
    },
    /// VSPs of an answer that was broken off.
    Forget(Vec<u32>),
}

/// A change for which the closure is searched, then gone through.
#[derive(Debug)]
pub struct Change {
    search: Search,
    is_found: bool,
}

impl Change {
    /// Goes on with the search, then with `apply` for every VSP; whether all is done.
    fn step<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        steps: &mut u64,
        mut apply: impl FnMut(u32),
    ) -> Result<bool, CollectError> {
        while *steps > 0 {
            *steps -= 1;
            if !self.is_found {
                self.is_found = self.search.step(file, SEARCHED_A_STEP)?;
                continue;
            }
            for _ in 0..SEARCHED_A_STEP {
                match self.search.next_id() {
                    Some(vsp) => apply(vsp),
                    None => return Ok(true),
                }
            }
        }
        Ok(false)
    }
}

/// Begins or goes on with a change.
fn go_on<D: AsRef<[u8]>>(
    change: &mut Option<Change>,
    file: &SpmFile<D>,
    region: RegionAt,
    steps: &mut u64,
    apply: impl FnMut(u32),
) -> Result<bool, CollectError> {
    let change = match change {
        Some(change) => change,
        None => change.insert(Change {
            search: Search::new(file, region)?,
            is_found: false,
        }),
    };
    change.step(file, steps, apply)
}

impl<D: AsRef<[u8]>> Station<D> {
    /// Makes the changes that wait in a session, with so many steps at the most; whether none is
    /// left.
    pub(super) fn apply_residency_changes(&mut self, at: usize, steps: &mut u64) -> bool {
        while *steps > 0 {
            let Some(mut waiting) = self.sessions[at].residency_changes.pop_front() else {
                return true;
            };
            if !self.apply(at, &mut waiting, steps) {
                self.sessions[at].residency_changes.push_front(waiting);
            }
        }
        self.sessions[at].residency_changes.is_empty()
    }

    /// Goes on with a change; whether it is made.
    fn apply(&mut self, at: usize, waiting: &mut ResidencyChange, steps: &mut u64) -> bool {
        let Self {
            models, sessions, ..
        } = self;
        let residency: &mut Residency = &mut sessions[at].residency;
        match waiting {
            ResidencyChange::Held { model, ask, change } => {
                let region = super::region_at(ask);
                if change.is_none() && !residency.hold(region) {
                    return true;
                }
                let file = &models[*model].file;
                let made = go_on(change, file, region, steps, |vsp| {
                    residency.add(vsp);
                });
                match made {
                    Ok(made) => made,
                    Err(error) => {
                        residency.release(region);
                        self.refuse_held(at, *model, *ask, &error);
                        true
                    }
                }
            }
            ResidencyChange::Released {
                model,
                region,
                change,
            } => {
                if change.is_none() && !residency.release(*region) {
                    return true;
                }
                let file = &models[*model].file;
                let made = go_on(change, file, *region, steps, |vsp| residency.subtract(vsp));
                match made {
                    Ok(made) => made,
                    Err(_) => {
                        // It was readable when it was taken in. Without it the counts cannot be
                        // kept.
                        sessions[at].break_epoch();
                        true
                    }
                }
            }
            ResidencyChange::Forget(vsps) => {
                while *steps > 0 && !vsps.is_empty() {
                    *steps -= 1;
                    let rest = vsps.len().saturating_sub(SEARCHED_A_STEP as usize);
                    vsps.drain(rest..).for_each(|vsp| residency.subtract(vsp));
                }
                vsps.is_empty()
            }
        }
    }
}
