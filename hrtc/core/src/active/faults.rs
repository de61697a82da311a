//! The faults that ended the use of a scene's models.

use crate::streaming::Fault;

/// For each model, the fault that ended its use.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct ModelFaults {
    of_model: Vec<Option<Fault>>,
    /// Models that are not known and cannot be, for a fault.
    lost: usize,
    /// Tick in which the station was first noted to have no place.
    turned_away: Option<u64>,
}

impl ModelFaults {
    pub fn new(models: usize) -> Self {
        Self {
            of_model: vec![None; models],
            lost: 0,
            turned_away: None,
        }
    }

    /// Number of models.
    pub fn models(&self) -> usize {
        self.of_model.len()
    }

    pub fn of(&self, model: usize) -> Option<Fault> {
        self.of_model[model]
    }

    pub fn any(&self) -> bool {
        self.of_model.iter().any(Option::is_some)
    }

    /// Models that are not known and cannot be.
    pub fn lost(&self) -> usize {
        self.lost
    }

    /// Another station: it may serve what the last one could not.
    pub fn clear(&mut self) {
        self.of_model.fill(None);
        self.lost = 0;
        self.turned_away = None;
    }

    /// Takes the faults of sessions over. `is_known`: which models are.
    pub fn note(
        &mut self,
        ended: impl Iterator<Item = (usize, Option<Fault>)>,
        is_known: impl Fn(usize) -> bool,
        tick: u64,
    ) {
        for (model, fault) in ended {
            self.of_model[model] = fault;
        }
        let is_turned_away = self.of_model.contains(&Some(Fault::NoPlace));
        self.turned_away = is_turned_away.then(|| self.turned_away.unwrap_or(tick));
        self.count(is_known);
    }

    /// Whether what the station had no place for is to be asked for again, so many ticks after it
    /// was noted: another controller may have ended. Those models have no fault then.
    pub fn try_again(&mut self, tick: u64, after: u64, is_known: impl Fn(usize) -> bool) -> bool {
        if self.turned_away.is_none_or(|since| tick < since + after) {
            return false;
        }
        self.turned_away = None;
        for fault in &mut self.of_model {
            *fault = fault.filter(|&of| of != Fault::NoPlace);
        }
        self.count(is_known);
        true
    }

    fn count(&mut self, is_known: impl Fn(usize) -> bool) {
        let faults = self.of_model.iter().enumerate();
        self.lost = faults
            .filter(|&(k, of)| of.is_some() && !is_known(k))
            .count();
    }
}
