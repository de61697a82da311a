//! Prediction of one probe towards one object.

use super::forecast::ContactForecast;
use super::predict::Predictor;

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
    pub fn new() -> Self {
        Self {
            predictor: Predictor::new(),
            forecast: ContactForecast::new(),
            finest: 0,
        }
    }

    /// The probe comes near: its history begins.
    pub fn begin(&mut self) {
        self.predictor.reset();
        self.forecast = ContactForecast::new();
        self.finest = 0;
    }
}
