//! This program again as other processes: starting, watching and ending them, and their roles.
//!
//! | module | holds |
//! |---|---|
//! | [`process`] | one process in a role |
//! | [`own_domain`] | the domain of one run, and what killed ones left |
//! | [`watched`] | a process and what it said so far |
//! | [`pair`] | the station and the controller of a run |
//! | [`roles`] | the station's and the controller's role |
//! | [`bare_loop`] | the role of the loop that the controller is compared with |
//! | [`load`] | the role of load on the other core |
//! | [`surroundings`] | core and environment of a process, and what is taken from it on purpose |
//! | [`host`], [`mounts`] | a network, shared memory and folders that only some processes have |
//! | [`rights`] | the rights of this process |
//! | [`device_page`] | a device in a process of its own, and its driver |
//! | [`voice`] | forged heartbeats in a domain |
//! | [`stamped_device`] | the simulated device with stamps of the loop |
//! | [`stop`] | the flag that ends a role or a command |

pub mod bare_loop;
pub mod device_page;
pub mod host;
pub mod load;
pub mod mounts;
pub mod own_domain;
pub mod pair;
pub mod process;
pub mod rights;
pub mod roles;
pub mod stamped_device;
pub mod stop;
pub mod surroundings;
pub mod voice;
pub mod watched;
