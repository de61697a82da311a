//! The commands that measure in virtual time or without a run, as a user types them.

mod accuracy;
mod compare;
mod effects;
mod fronts;
mod interrupted;
mod predictors;
mod stability;
mod stability_peers;
mod thesis;
mod tools;
mod typed;
