//! Prediction of one probe towards one object.

use super::forecast::ContactForecast;
use super::predict::Predictor;
use crate::horizons::Horizons;

/// Prediction of one probe towards one object.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Approach {
    /// Where the probe goes.
    pub predictor: Predictor,
    /// Where other parts of a tool may touch next.
    pub forecast: ContactForecast,
    /// The finest ring that is asked for around this probe.
    pub finest: usize,
}

impl Approach {
    /// No history.
    #[must_use]
    pub fn new(horizons: &Horizons) -> Self {
        Self {
            predictor: Predictor::new(horizons),
            forecast: ContactForecast::new(horizons.prediction.refine_ahead),
            finest: 0,
        }
    }

    /// The probe comes near: its history begins.
    pub fn begin(&mut self) {
        self.predictor.reset();
        self.forecast.reset();
        self.finest = 0;
    }
}
