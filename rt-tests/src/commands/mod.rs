//! One file or folder for each command of `rt-tests`. None uses another, but `hosts` the cases of
//! `faults`.
//!
//! | module | command |
//! |---|---|
//! | [`run`] | both processes on a scene, with a closing report |
//! | [`jitter`] | the timing of the loop beside a bare loop |
//! | [`replay`] | a recording through the controller again |
//! | [`export`] | a recording as tables |
//! | [`fronts`] | fronts are legal, certified and cheap, on any mesh |
//! | [`accuracy`] | the cost of accuracy, from the base mesh to the full mesh |
//! | [`compare`] | a query and an update beside those of parry |
//! | [`predictors`] | the gain of each source of the prediction |
//! | [`stability`] | the hard cases |
//! | [`simulate`] | random faults on both cores in virtual time |
//! | [`faults`] | real processes killed, stopped, replaced and starved in contact |
//! | [`codecs`] | what a record costs on the wire, by codec |
//! | [`hosts`] | station and controller on two hosts, over links of any length |
//! | [`effects`] | the cost of each effect |
//! | [`tools`] | a tool's ticks beside unlimited work |
//! | [`view`] | a touch of a recording as a picture or a film |
//! | [`zwidth`] | the stiffest wall that can be rendered |

pub mod accuracy;
pub mod codecs;
pub mod compare;
pub mod effects;
pub mod export;
pub mod faults;
pub mod fronts;
pub mod hosts;
pub mod jitter;
pub mod predictors;
pub mod replay;
pub mod run;
pub mod simulate;
pub mod stability;
pub mod tools;
pub mod view;
pub mod zwidth;
