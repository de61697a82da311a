//! The faults that ended the use of a scene's models.

use crate::streaming::Fault;

/// For each model, the fault that ended its use.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub(super) struct ModelFaults {
    of_model: Vec<Option<Fault>>,
    /// Which of these models are asked for again.
    is_asked: Vec<bool>,
    /// How many have one.
    count: usize,
    /// How often that of a model became another one, or ended.
    changes: u64,
    /// Models that are not known, for a fault.
    lost: usize,
    /// Where the station had no place for a model, and is not asked again: the tick in which it
    /// said so.
    turned_away: Option<u64>,
    /// Whether any model is asked for again.
    is_asking: bool,
}

impl ModelFaults {
    pub fn new(models: usize) -> Self {
        Self {
            of_model: vec![None; models],
            is_asked: vec![false; models],
            count: 0,
            changes: 0,
            lost: 0,
            turned_away: None,
            is_asking: false,
        }
    }

    /// Number of models.
    pub fn models(&self) -> usize {
        self.of_model.len()
    }

    /// The fault of a model, also while that is asked for again.
    pub fn of(&self, model: usize) -> Option<Fault> {
        self.of_model[model]
    }

    /// Whether any model has one.
    pub fn any(&self) -> bool {
        self.count > 0
    }

    /// Another number whenever the fault of a model is another one or has ended; 0 before the
    /// first.
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// Models that are not known, for a fault: nothing waits for them.
    pub fn lost(&self) -> usize {
        self.lost
    }

    /// Whether a model is not to be asked for.
    pub fn is_closed(&self, model: usize) -> bool {
        self.of_model[model].is_some() && !self.is_asked[model]
    }

    /// Whether the station is asked again for anything.
    pub fn is_asking(&self) -> bool {
        self.is_asking
    }

    /// Another station: it may serve what the last one could not, and is asked for all of it. Until
    /// a model comes it counts as lost, so that the forces of the others go on; where there are no
    /// others, all is awaited as at the start.
    pub fn ask_again(&mut self, is_known: impl Fn(usize) -> bool) {
        self.turned_away = None;
        if !(0..self.of_model.len()).any(&is_known) {
            self.changes += u64::from(self.any());
            self.of_model.fill(None);
        }
        for (is_asked, fault) in self.is_asked.iter_mut().zip(&self.of_model) {
            *is_asked = fault.is_some();
        }
        self.settle(is_known);
    }

    /// Takes the faults of sessions over. `is_known`: which models are.
    pub fn note(
        &mut self,
        ended: impl Iterator<Item = (usize, Option<Fault>)>,
        is_known: impl Fn(usize) -> bool,
        tick: u64,
    ) {
        let mut has_no_place = false;
        for (model, fault) in ended {
            let before = std::mem::replace(&mut self.of_model[model], fault);
            self.changes += u64::from(before != fault);
            self.is_asked[model] = false;
            has_no_place |= fault == Some(Fault::NoPlace);
        }
        if has_no_place {
            self.turned_away = self.turned_away.or(Some(tick));
            // What has no place either is asked for together, later.
            for (is_asked, fault) in self.is_asked.iter_mut().zip(&self.of_model) {
                *is_asked &= *fault != Some(Fault::NoPlace);
            }
        }
        self.settle(is_known);
    }

    /// Whether what the station had no place for is to be asked for again, so many ticks after it
    /// was refused: another controller may have ended. It counts as lost as in
    /// [`ModelFaults::ask_again`].
    pub fn try_again(&mut self, tick: u64, after: u64, is_known: impl Fn(usize) -> bool) -> bool {
        if self.turned_away.is_none_or(|since| tick < since + after) {
            return false;
        }
        self.turned_away = None;
        for (is_asked, fault) in self.is_asked.iter_mut().zip(&self.of_model) {
            *is_asked |= *fault == Some(Fault::NoPlace);
        }
        self.settle(is_known);
        true
    }

    /// Counts the faults, and what is lost and asked for. A model that is asked for again and here,
    /// or has come, is a matter of its session.
    fn settle(&mut self, is_known: impl Fn(usize) -> bool) {
        (self.count, self.lost, self.is_asking) = (0, 0, false);
        let models = self.of_model.iter_mut().zip(&mut self.is_asked);
        for (model, (fault, is_asked)) in models.enumerate() {
            let is_known = is_known(model);
            if *is_asked && is_known {
                self.changes += u64::from(fault.is_some());
                (*fault, *is_asked) = (None, false);
            }
            self.count += usize::from(fault.is_some());
            self.lost += usize::from(fault.is_some() && !is_known);
            self.is_asking |= *is_asked;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNKNOWN: Fault = Fault::UnknownModel;

    /// Of four models the first two are known, and the others have faults.
    fn faulty(faults: [Fault; 2]) -> ModelFaults {
        let mut all = ModelFaults::new(4);
        let ended = faults.into_iter().zip(2..);
        all.note(ended.map(|(fault, model)| (model, Some(fault))), two, 10);
        all
    }

    fn two(model: usize) -> bool {
        model < 2
    }

    #[test]
    fn what_another_station_is_asked_for_stays_lost_until_it_comes() {
        let mut faults = faulty([UNKNOWN, Fault::DamagedModel]);
        assert_eq!((faults.lost(), faults.is_asking()), (2, false));
        faults.ask_again(two);
        assert_eq!((faults.lost(), faults.is_asking()), (2, true));
        assert!(!faults.is_closed(2) && !faults.is_closed(3));
        // One is refused again, the other comes.
        faults.note([(2, Some(UNKNOWN))].into_iter(), two, 20);
        assert!(faults.is_closed(2) && !faults.is_closed(3));
        assert_eq!((faults.lost(), faults.is_asking()), (2, true));
        faults.note([(2, Some(UNKNOWN))].into_iter(), |model| model != 2, 30);
        assert_eq!((faults.lost(), faults.is_asking()), (1, false));
        assert_eq!([2, 3].map(|model| faults.of(model)), [Some(UNKNOWN), None]);
    }

    #[test]
    fn what_is_told_once_is_told_again_when_it_changes_only() {
        let mut faults = ModelFaults::new(4);
        let mut told = faults.changes();
        assert_eq!((told, faults.any()), (0, false));
        let mut is_news = |faults: &ModelFaults| {
            let before = std::mem::replace(&mut told, faults.changes());
            before != told
        };
        faults.note([(2, Some(UNKNOWN))].into_iter(), two, 10);
        assert!(faults.any() && is_news(&faults));
        faults.note([(2, Some(UNKNOWN))].into_iter(), two, 11);
        assert!(!is_news(&faults), "it is the same one");
        faults.ask_again(two);
        assert!(
            faults.any() && !is_news(&faults),
            "it stays while it is asked for"
        );
        faults.note(std::iter::empty(), |_| true, 12);
        assert!(!faults.any() && is_news(&faults), "the model has come");
    }

    #[test]
    fn a_fault_of_a_model_that_is_here_ends_with_the_station() {
        let mut faults = ModelFaults::new(2);
        faults.note([(1, Some(Fault::AnotherModel))].into_iter(), two, 10);
        assert_eq!((faults.lost(), faults.any()), (0, true));
        faults.ask_again(two);
        assert!(!faults.any() && !faults.is_asking());
    }

    #[test]
    fn where_nothing_was_known_all_is_awaited_of_another_station() {
        let mut faults = ModelFaults::new(1);
        faults.note([(0, Some(UNKNOWN))].into_iter(), |_| false, 10);
        assert_eq!(faults.lost(), 1);
        faults.ask_again(|_| false);
        assert_eq!((faults.lost(), faults.any()), (0, false));
        assert!(!faults.is_closed(0));
    }

    #[test]
    fn what_has_no_place_is_asked_for_together_some_time_after_the_first_was_refused() {
        let mut faults = faulty([Fault::NoPlace; 2]);
        assert!(!faults.try_again(14, 5, two) && faults.is_closed(2));
        assert!(faults.try_again(15, 5, two) && faults.is_asking());
        assert!(!faults.is_closed(2) && !faults.is_closed(3));
        assert!(!faults.try_again(100, 5, two), "it is asked already");
        // One is refused: so would be the other.
        faults.note([(2, Some(Fault::NoPlace))].into_iter(), two, 20);
        assert!(faults.is_closed(2) && faults.is_closed(3));
        faults.note([(3, Some(Fault::NoPlace))].into_iter(), two, 22);
        assert!(!faults.try_again(24, 5, two) && faults.try_again(25, 5, two));
        faults.note(std::iter::empty(), |_| true, 26);
        assert!(!faults.any() && !faults.try_again(100, 5, two));
    }
}
