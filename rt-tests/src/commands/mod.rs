//! One file or folder for each command of `rt-tests`. None uses another, but `hosts` the cases of
//! `faults`, `policies` the scenes of `deadline`, `thesis` the measures of `compare` and `fronts`,
//! and `check` those of `zwidth`.
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
//! | [`costs`] | the cost of a unit of the tick's work on this machine |
//! | [`deadline`] | deadlines and errors on slower machines |
//! | [`policies`] | the policies of detail at equal time |
//! | [`predictors`] | the gain of each source of the prediction |
//! | [`stability`] | the hard cases |
//! | [`simulate`] | random faults on both cores in virtual time |
//! | [`faults`] | real processes killed, stopped, replaced and starved in contact |
//! | [`codecs`] | what a record costs on the wire, by codec |
//! | [`hosts`] | station and controller on two hosts, over links of any length |
//! | [`check`] | what this machine is good for, in a minute |
//! | [`thesis`] | the figures of the thesis, its numbers beside ours |
//! | [`effects`] | the cost of each effect |
//! | [`tools`] | a tool's ticks beside unlimited work |
//! | [`tune`] | the settings that keep a limit of error, time, bytes or memory |
//! | [`view`] | a touch of a recording as a picture or a film |
//! | [`zwidth`] | the stiffest wall that can be rendered |

pub mod accuracy;
pub mod check;
pub mod codecs;
pub mod compare;
pub mod costs;
pub mod deadline;
pub mod effects;
pub mod export;
pub mod faults;
pub mod fronts;
pub mod hosts;
pub mod jitter;
pub mod policies;
pub mod predictors;
pub mod replay;
pub mod run;
pub mod simulate;
pub mod stability;
pub mod thesis;
pub mod tools;
pub mod tune;
pub mod view;
pub mod zwidth;
