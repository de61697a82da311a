//! The faults that ended the use of a scene's models.

use crate::streaming::Fault;

/// For each model, the fault that ended its use.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct ModelFaults {
    of_model: Vec<Option<Fault>>,
    /// Models that are not known, for a fault.
    lost: usize,
    /// Where the station had no place for a model: the tick in which it first said so, or said so
    /// again when it was asked again.
    turned_away: Option<u64>,
    /// Whether it is being asked again.
    is_asking: bool,
}

impl ModelFaults {
    pub fn new(models: usize) -> Self {
        Self {
            of_model: vec![None; models],
            lost: 0,
            turned_away: None,
            is_asking: false,
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

    /// Models that are not known, for a fault: nothing waits for them.
    pub fn lost(&self) -> usize {
        self.lost
    }

    /// Whether a model is not to be asked for.
    pub fn is_closed(&self, model: usize) -> bool {
        match self.of_model[model] {
            Some(Fault::NoPlace) => !self.is_asking,
            other => other.is_some(),
        }
    }

    /// Whether the station is asked again for what it had no place for.
    pub fn is_asking(&self) -> bool {
        self.is_asking
    }

    /// Another station: it may serve what the last one could not.
    pub fn clear(&mut self) {
        self.of_model.fill(None);
        self.lost = 0;
        self.turned_away = None;
        self.is_asking = false;
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
            if fault == Some(Fault::NoPlace) {
                let is_refused_again = std::mem::take(&mut self.is_asking);
                let since = self.turned_away.filter(|_| !is_refused_again);
                self.turned_away = Some(since.unwrap_or(tick));
            }
        }
        self.settle(is_known);
    }

    /// Whether what the station had no place for is to be asked for again, so many ticks after it
    /// was refused: another controller may have ended. Until a model comes it counts as lost, so
    /// that the forces of the others go on.
    pub fn try_again(&mut self, tick: u64, after: u64, is_known: impl Fn(usize) -> bool) -> bool {
        if self.is_asking || self.turned_away.is_none_or(|since| tick < since + after) {
            return false;
        }
        self.is_asking = true;
        self.settle(is_known);
        true
    }

    /// Counts what is lost. A model that is asked for again and here, or has come, is a matter of
    /// its session.
    fn settle(&mut self, is_known: impl Fn(usize) -> bool) {
        if self.is_asking {
            for (model, fault) in self.of_model.iter_mut().enumerate() {
                *fault = fault.filter(|&of| of != Fault::NoPlace || !is_known(model));
            }
            if !self.of_model.contains(&Some(Fault::NoPlace)) {
                (self.turned_away, self.is_asking) = (None, false);
            }
        }
        let faults = self.of_model.iter().enumerate();
        self.lost = faults
            .filter(|&(k, of)| of.is_some() && !is_known(k))
            .count();
    }
}
